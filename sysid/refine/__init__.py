"""The page of a refinement: a task before and after the simulation was given what identification found."""

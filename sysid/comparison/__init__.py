"""Pages of comparisons: real against simulated, before against after."""

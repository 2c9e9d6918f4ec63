"""Reports of runs: pure functions of exported logs."""

"""Figures, verdicts and pages of experiments, from the logs of their runs."""

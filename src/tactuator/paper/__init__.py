"""The paper's study, end to end, on the simulated display."""

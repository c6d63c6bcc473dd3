"""The verb `experiment` and its parts."""

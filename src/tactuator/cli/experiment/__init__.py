"""The verb `experiment` and its parts: detection and identification, with people or with observers."""

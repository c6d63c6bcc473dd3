"""The verb `experiment` and its parts: detection and recognition, with people or with observers."""

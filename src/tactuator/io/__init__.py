"""Files that a person can open: read, validated, written beside and then renamed."""

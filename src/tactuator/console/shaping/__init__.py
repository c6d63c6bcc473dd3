"""The feedback controller as factors that a person can take hold of."""

"""The verb that opens the console."""

"""The console's verb."""

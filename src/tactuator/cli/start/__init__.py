"""The verb that writes files to start from: init."""

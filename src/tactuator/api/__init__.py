"""The API: one typed function for each command, which returns one result. Command line, console and Python call these.

`cli/commands.py` has the functions by the names that the command line gives them.
"""

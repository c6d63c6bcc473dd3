"""The verbs: one typed function for each, which returns one result; command line, console and Python call these.

A module of verbs is read for every `--help`, so it imports nothing heavy: a verb brings in what it needs when it is
called, and quotes types of such rooms. `table` has the verbs by the names that the command line gives them.
"""

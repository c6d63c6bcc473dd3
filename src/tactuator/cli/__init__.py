"""The command line `tactuator VERB ... [--json]`; it only asks and prints, and computes nothing.

Each verb is a module of the same name in the room of its group, and a signature in that room's `verbs`; the module is
imported when the verb is run. `main` keeps the promises that hold for all of them: exit status 0 (done), 1 (done, and
the verdict is no), 2 (bad input or no design), 3 (a device failed), both told in one line on standard error, 130
(interrupted), 70 (a defect of tactuator, with its traceback).
"""

from tactuator.cli.main import main

__all__ = ["main"]

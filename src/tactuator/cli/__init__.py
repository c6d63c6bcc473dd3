"""The command line `tactuator COMMAND ... [--json]`; it only asks and prints, and computes nothing.

`commands` names the commands, `app` lists them, `command` makes one of a signature in `tactuator.api`, `output` prints
results, `main` keeps the promises that hold for all: exit status 0 (done), 1 (done, and the verdict is no), 2 (bad
input or no design), 3 (a device failed), both with one line on standard error, 130 (interrupted), 70 (a bug in
tactuator, with its traceback).
"""

from tactuator.cli.main import main

__all__ = ["main"]

"""Make `.venv` what the lock files and the sources say it is: `python3 tools/install.py run|test|site`.

Needs Python 3.11 or later with venv and pip, its C headers and a C compiler. Nothing is done when nothing changed
(tools/stamps.py); a file lock lets one run at a time do the work. What goes wrong is told in one line, and the next
run starts clean. The syntax of this file stays old: a Python too old must get as far as being told so.
"""

import sys

if sys.version_info < (3, 11):
    sys.exit(
        "tactuator needs Python 3.11 or later; %s is %d.%d: give another with `make PYTHON=python3.11 ...`"
        % (sys.executable, sys.version_info[0], sys.version_info[1])
    )

import fcntl
import os

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

from tools import build, needs, packages, stamps


def main():
    """Do what is needed, one run at a time."""
    which = sys.argv[1] if len(sys.argv) == 2 else ""
    if which not in stamps.LOCKS:
        sys.exit("usage: python3 tools/install.py run|test|site")
    folder = stamps.ROOT / ".setup"
    folder.mkdir(exist_ok=True)
    with open(folder / "lock", "w", encoding="ascii") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        wanted, how = stamps.packages_wanted(which, stamps.read_stamp())
        if wanted or build.is_due():
            needs.check()
        if wanted:
            packages.install(wanted, how)
        if build.is_due():
            build.build()


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        sys.exit(130)
    except OSError as error:
        sys.exit("the set-up could not go on: %s" % needs.reason(error))

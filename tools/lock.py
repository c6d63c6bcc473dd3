"""Resolve `requirements/*.in` into hashed locks for every Python from 3.11 up: `make lock`.

No line of a lock names a host: the index is the machine's own affair.
"""

import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from install import LOCKS, ROOT, UV, uv_environment

HEADER = "# Written by `make lock` from %s; not to be edited.\n"
QUIET = ["--quiet", "--no-header", "--no-annotate", "--no-emit-index-url", "--no-emit-find-links"]


def main():
    """Compile the runtime set first: the test set keeps its versions."""
    for lock in LOCKS.values():
        source = lock.with_suffix(".in")
        command = [UV, "pip", "compile", "--universal", "--python-version", "3.11", "--generate-hashes", *QUIET]
        done = subprocess.run(
            [*command, *sys.argv[1:], source, "--output-file", lock], cwd=ROOT, env=uv_environment(), check=False
        )
        if done.returncode != 0:
            sys.exit("%s could not be resolved" % source.name)
        text = lock.read_text()
        if "://" in text:
            sys.exit("%s names a host: %s" % (lock.name, next(line for line in text.splitlines() if "://" in line)))
        if not text.startswith(HEADER % source.name):
            lock.write_text(HEADER % source.name + text)


if __name__ == "__main__":
    main()

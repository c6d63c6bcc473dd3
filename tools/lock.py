"""Resolve `requirements/*.in` into hashed locks, with pip-tools: `make lock`.

It is done with the oldest Python that is supported, so one version of each package serves every later one too. No line
of a lock names a host: the index is the machine's own affair.
"""

import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOCKS = ("run", "test", "site", "wheel")
HEADER = "# Written by `make lock` from %s.in; not to be edited.\n"
OPTIONS = [
    *("--quiet", "--no-header", "--no-annotate", "--strip-extras", "--generate-hashes"),
    *("--no-emit-index-url", "--no-emit-trusted-host", "--no-emit-find-links", "--no-emit-options"),
    *("--unsafe-package", "pip"),  # pip is the virtual environment's own; setuptools is pinned like all others
]


def oldest_python():
    """Return the oldest Python that pyproject.toml admits, as (major, minor)."""
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["requires-python"]
    return tuple(int(part) for part in wanted.removeprefix(">=").split("."))


def cleaned(name, text):
    """Return a lock under its heading, without the resolver's remarks; refuse one that names a host."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    naming = [line for line in lines if "://" in line or line.startswith("--")]
    if naming:
        sys.exit("the lock of %s.in would name a host, or carry an option: %s" % (name, naming[0]))
    return HEADER % name + "\n".join(lines) + "\n"


def resolve(name, more):
    """Write one lock anew; what it pins already stays, unless `more` says otherwise."""
    lock = ROOT / "requirements" / (name + ".txt")
    part = lock.with_suffix(".part")
    part.write_text(lock.read_text(encoding="ascii") if lock.exists() else "", encoding="ascii")
    try:
        command = [
            sys.executable,
            "-m",
            "piptools",
            "compile",
            *OPTIONS,
            *more,
            "--output-file",
            part.name,
            name + ".in",
        ]
        done = subprocess.run(command, cwd=lock.parent, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            sys.exit("%s.in could not be resolved:\n%s" % (name, (done.stderr or done.stdout).strip()))
        part.write_text(cleaned(name, part.read_text(encoding="ascii")), encoding="ascii")
        part.rename(lock)
    finally:
        part.unlink(missing_ok=True)


def main():
    """Resolve the runtime set first: the larger sets keep its versions."""
    oldest = oldest_python()
    if sys.version_info[:2] != oldest:
        sys.exit(
            "the locks are resolved with Python %d.%d, the oldest supported; .venv has %d.%d: "
            "`make clean`, then `make PYTHON=python%d.%d lock`" % (*oldest, *sys.version_info[:2], *oldest)
        )
    for name in LOCKS:
        print("lock: resolving %s.in (half a minute or more)" % name, file=sys.stderr, flush=True)
        resolve(name, sys.argv[1:])


if __name__ == "__main__":
    main()

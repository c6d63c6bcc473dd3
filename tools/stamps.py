"""Stamps in `.venv`: what it was made from, and so what is left to do."""

import hashlib
import json
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
PACKAGES_STAMP = VENV / "packages.stamp"
BUILD_STAMP = VENV / "build.stamp"
#: Each set holds the one before it, at the same versions.
LOCKS = {name: ROOT / "requirements" / (name + ".txt") for name in ("run", "test", "site")}


def file_hash(path):
    """Return the SHA-256 of a file, in hex."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def build_sources():
    """Return every file that the build of the package reads, in a fixed order."""
    named = [ROOT / "pyproject.toml", ROOT / "setup.py", *(ROOT / "src").rglob("_core_build.py")]
    core = [file for file in (ROOT / "core").rglob("*") if file.is_file() and file.suffix != ".o"]
    return sorted(named + core)


def sources_hash():
    """Return one hash of all that the build reads, names included, and of the interpreter."""
    digest = hashlib.sha256(sys.version.encode())
    for file in build_sources():
        digest.update(str(file.relative_to(ROOT)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def built_with():
    """Return what a `.venv` cannot survive a change of: the interpreter, and the place."""
    return {"python": sys.version, "prefix": os.path.realpath(sys.base_prefix), "root": str(ROOT)}


def read_stamp():
    """Return what `.venv` was made from; nothing when it is not (wholly) there."""
    try:
        return json.loads(PACKAGES_STAMP.read_text())
    except (OSError, ValueError):
        return {}


def sets_within(which):
    """Return the names of the sets that `which` holds, itself among them, the smallest first."""
    names = list(LOCKS)
    return names[: names.index(which) + 1]


def packages_wanted(which, stamp):
    """Return the set to install and how: (None, ""), (set, "anew"), or (set, "add").

    A larger set holds the smaller ones at the same versions, so it serves for them too. A lock that changed means
    `.venv` anew, for the largest set that it held: nothing stays behind that no lock names.
    """
    usable = all(stamp.get(key) == value for key, value in built_with().items()) and PYTHON.exists()
    if not usable:
        return which, "anew"
    have, adding = stamp.get("locks", {}), stamp.get("adding", False)
    current = [name for name in LOCKS if name in have and have[name] == file_hash(LOCKS[name])]
    if all(name in current for name in sets_within(which)):
        return None, ""
    if which not in have and len(current) == len(have) and not adding:
        return which, "add"
    return max([which, *have], key=list(LOCKS).index), "anew"


def write_packages_stamp(*sets, adding=False):
    """Record that `.venv` holds these sets; `adding`: and perhaps a part of the test set."""
    held = {name: file_hash(LOCKS[name]) for name in sets}
    write(PACKAGES_STAMP, json.dumps(dict(built_with(), locks=held, adding=adding)))


def write(path, text):
    """Write beside, then rename: a stamp is whole or absent."""
    part = path.with_suffix(".part")
    part.write_text(text)
    part.rename(path)

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
LOCKS = {"run": ROOT / "requirements" / "run.txt", "test": ROOT / "requirements" / "test.txt"}


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


def packages_wanted(which, stamp):
    """Return the set to install and how: (None, ""), (set, "anew"), or ("test", "add").

    A test set holds the runtime set at the same versions, so it serves both. A lock that changed means `.venv` anew,
    for the larger set of the two that it held: nothing stays behind that no lock names.
    """
    usable = all(stamp.get(key) == value for key, value in built_with().items()) and PYTHON.exists()
    if not usable:
        return which, "anew"
    have, adding = stamp.get("locks", {}), stamp.get("adding", False)
    run_current = have.get("run") == file_hash(LOCKS["run"])
    test_current = have.get("test") == file_hash(LOCKS["test"])
    if run_current and (which == "run" or test_current):
        return None, ""
    if run_current and "test" not in have and not adding:
        return "test", "add"
    return ("test" if "test" in have else which), "anew"


def write_packages_stamp(*sets, adding=False):
    """Record that `.venv` holds these sets; `adding`: and perhaps a part of the test set."""
    held = {name: file_hash(LOCKS[name]) for name in sets}
    write(PACKAGES_STAMP, json.dumps(dict(built_with(), locks=held, adding=adding)))


def write(path, text):
    """Write beside, then rename: a stamp is whole or absent."""
    part = path.with_suffix(".part")
    part.write_text(text)
    part.rename(path)

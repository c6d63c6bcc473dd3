"""Freeze what every command gives on the examples, and say what has changed since.

    python -m tests.golden write [FOLDER] [--only SECTION ...]
    python -m tests.golden compare [FOLDER] [--only SECTION ...] [--within 1e-6] [--all]

commands.txt has the commands. FOLDER (default: frozen/ beside this file) has one JSON of each section: command, key,
value. `compare` tells for each command the keys that are gone (-), new (+) and changed (~, with how much); what is the
same in three commands or more is told once. Status 1: something differs. Numbers may differ by --within: a design or a
model found on another processor takes 1e-4.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.golden.compared import differences, report
from tests.golden.inputs import make
from tests.golden.reduced import Flat, file, flatten, lines

HERE = Path(__file__).resolve().parent
FEW = 12
"""A longer text that an earlier command of the section gave is not repeated."""
SHIPPED = "lab"
"""The folder into which the examples are copied: of these the name alone is kept, they are in the repository."""
ENVIRONMENT = {
    "PYTHONPATH": os.pathsep.join([str(Path.cwd()), str(HERE.parents[1])]),
    "COLUMNS": "200",
    "TERM": "dumb",
    "NO_COLOR": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "LOGNAME": "golden",
    "USER": "golden",
}


def sections() -> dict[str, list[tuple[str, str]]]:
    """The commands: of each section its names, with the mark, and words."""
    found: dict[str, list[tuple[str, str]]] = {}
    for line in (HERE / "commands.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("["):
            found[line.strip("[]")] = rows = []
        elif line and not line.startswith("#"):
            name, _, words = line.partition(": ")
            rows.append((name, words))
    return found


def run(words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command of the program, or a program of inputs/ (python NAME.py ...)."""
    own = words.startswith("python ")
    command = [sys.executable, *(shlex.split(words)[1:] if own else ["-m", "tactuator", *shlex.split(words)])]
    return subprocess.run(
        command,
        cwd=folder,
        env=os.environ | ENVIRONMENT,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )


def seen(folder: Path) -> dict[str, tuple[int, int]]:
    """Every file of the folder: when it was written, and its size."""
    paths = [path for path in folder.rglob("*") if path.is_file() and not path.name.endswith(("-wal", "-shm", ".lock"))]
    return {
        path.relative_to(folder).as_posix(): (path.stat().st_mtime_ns, path.stat().st_size) for path in sorted(paths)
    }


def given(name: str, words: str, folder: Path) -> Flat:
    """What one command gives."""
    before, found = seen(folder), Flat(command=words)
    files: dict[str, str] = {}
    for face in {"!": ["json"], "$": ["text"]}.get(name[0], ["json", "text"]):
        ended = run(words + (" --json" if face == "json" else ""), folder)
        found["status" if face == "json" or "status" not in found else "status of the text"] = ended.returncode
        out, err = (text.replace(str(folder), ".") for text in (ended.stdout, ended.stderr))
        try:
            flatten(json.loads(out), "json", found)
        except ValueError:
            found[f"{face}: out"] = lines(out)
        found[f"{face}: err"] = lines(err)
        for path, stamp in seen(folder).items() if face != "text" or name[0] == "$" else ():
            if before.get(path) == stamp:
                continue
            says = {} if SHIPPED in path else file(folder / path)
            if (first := files.setdefault(str(says), path)) != path or not says:
                found[path] = f"as {first}" if says else "there"
            else:
                found |= {f"{path}:{key}": value for key, value in says.items()}
    if found.get("status of the text") == found["status"]:
        del found["status of the text"]
    return {key: value for key, value in found.items() if value != []}


def outputs(section: str, commands: list[tuple[str, str]]) -> dict[str, Flat]:
    """What every command of a section gives."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made).resolve()
        run("init --examples .", folder)
        shutil.copytree(HERE / "inputs", folder, dirs_exist_ok=True)
        make(folder)
        for name in "abcdefgh":  # places for what is written beside something else
            (folder / name).mkdir()
        found: dict[str, Flat] = {}
        texts: dict[str, str] = {}
        for name, words in commands:
            print(f"{section}: {name}", file=sys.stderr, flush=True)
            if name[0] == "-":
                run(words, folder)
                continue
            found[name.lstrip("!$")] = one = given(name, words, folder)
            for key, value in one.items():
                if isinstance(value, list) and len(value) > FEW:
                    one[key] = [f"as {earlier}"] if (earlier := texts.get(str(value))) else value
                    texts.setdefault(str(value), f"{key} of {name}")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["write", "compare"])
    parser.add_argument("folder", type=Path, nargs="?", default=HERE / "frozen")
    parser.add_argument("--only", nargs="+", choices=sections(), default=list(sections()))
    parser.add_argument("--within", type=float, default=1e-6)
    parser.add_argument("--all", action="store_true", help="every difference, none gathered or left out")
    asked = parser.parse_args()
    rows = []
    for section in asked.only:
        path = asked.folder / f"{section}.json"
        if asked.what == "compare" and not path.exists():
            print(f"{section}: nothing is frozen", file=sys.stderr)
            continue
        found = outputs(section, sections()[section])
        if asked.what == "write":
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(found, ensure_ascii=False, indent=0) + "\n", encoding="utf-8")
        else:
            frozen = json.loads(path.read_text(encoding="utf-8"))
            rows += [(f"{section} {name}", key, line) for name, key, line in differences(frozen, found, asked.within)]
    report(rows, asked.all)
    return int(bool(rows))


if __name__ == "__main__":
    sys.exit(main())

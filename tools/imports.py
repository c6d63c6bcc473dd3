"""Import every runtime dependency once, in `.venv`: `.venv/bin/python tools/imports.py`.

Every package in requirements/run.in is imported by the very statements that the sources import it with. What cannot be
is named in one line with its remedy, and the exit status is 1.
"""

import ast
import importlib.metadata
import re
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
REMEDY = (
    "Remedy: `make clean`, then the same again; should it stay, pip was given a file that is not for this machine, "
    "and `pip config list` tells where it looks"
)


def dependencies():
    """Return the import name of every runtime dependency, by its name in requirements/run.in."""
    lines = (ROOT / "requirements" / "run.in").read_text(encoding="ascii").splitlines()
    names = [re.split(r"[\s<>=!~;\[#]", line.strip())[0] for line in lines]
    return {name: re.sub(r"[-.]", "_", name.lower()) for name in names if name and not name.startswith("-")}


def imports_in_sources():
    """Return every absolute import statement of the sources, by the package that it begins with."""
    found = {}
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            for name in names:
                found.setdefault(name.partition(".")[0], set()).add(ast.unparse(node))
    return found


def failure(statements):
    """Run imports in a process of their own; return why that cannot be, or nothing."""
    script = "\n".join(statements)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return ""
    if done.returncode < 0:
        return "the process ended by %s" % signal.Signals(-done.returncode).name
    return (done.stderr.strip().splitlines() or ["status %d, without a word" % done.returncode])[-1]


def installed(name):
    """Return the version of a package and what its file was made for, as far as it is there."""
    try:
        package = importlib.metadata.distribution(name)
    except importlib.metadata.PackageNotFoundError:
        return "(not installed)"
    tags = re.findall(r"^Tag: (\S+)", package.read_text("WHEEL") or "", flags=re.MULTILINE)
    return "%s (made for %s)" % (package.version, ", ".join(tags) or "what its file does not say")


def main():
    """Name in one line what cannot be imported: all together first, and one by one only when that fails."""
    found = imports_in_sources()
    statements = {
        name: ["import " + package, *sorted(found.get(package, ()))] for name, package in dependencies().items()
    }
    if not failure([line for lines in statements.values() for line in lines]):
        return
    said = {name: failure(lines) for name, lines in statements.items()}
    wrong = ["%s %s: %s" % (name, installed(name), why) for name, why in said.items() if why]
    if wrong:
        print("installed, but cannot be imported: %s. %s" % ("; ".join(wrong), REMEDY))
        sys.exit(1)


if __name__ == "__main__":
    main()

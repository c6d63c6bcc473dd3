"""The site's reference of the Python API: a page for each room of the package, from its docstrings."""

import ast
import re
from pathlib import Path

from sphinx.domains.python import PythonDomain

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "tactuator"
FOLDER = ROOT / "docs" / "python"
LISTED_IN = "docs/reference"  # two clicks from the start page
#: What a program of a laboratory calls, or a package of its own builds on; the rest is read in the source.
ROOMS = (
    "api", "signals", "perception", "model", "io", "rig", "speech", "experiment.procedure", "experiment.task",
)  # fmt: skip


class FindsOnce(PythonDomain):
    """Python's names, each looked for once: Sphinx goes through all of them at every name that it does not know."""

    def find_obj(self, env, modname, classname, name, type, searchmode=0):
        """Return what Sphinx finds, remembered for a name that is searched for by its end."""
        if searchmode != 1:
            return super().find_obj(env, modname, classname, name, type, searchmode)
        unknown = self.__dict__.setdefault("_unknown", set())
        if (len(self.objects), modname, name) in unknown:
            return []
        matches = super().find_obj(env, modname, classname, name, type, searchmode)
        if not matches:
            unknown.add((len(self.objects), modname, name))
        return matches


def room_page(room):
    """Return the page of one room: its modules in the order of their names, each with its docstrings."""
    names = [_dotted(path) for path in sorted(_folder(room).rglob("*.py"))]
    names = [name for name in names if not any(part.startswith("_") for part in name.split("."))]
    lines = [f"# tactuator.{room}", ""]
    for name in names:
        heading = [] if name == f"tactuator.{room}" else [f"## {name.removeprefix('tactuator.')}", ""]
        lines += [*heading, "```{eval-rst}", f".. automodule:: {name}", "   :members:", "```", ""]
    return "\n".join(lines)


def _list_rooms(app, page, source):
    if page == LISTED_IN:
        names = [f"- [`tactuator.{room}`](python/{room}.md): {_head(room)}" for room in ROOMS]
        source[0] = source[0].replace(
            "## Rooms of the package\n", "## Rooms of the package\n\n" + "\n".join(names) + "\n"
        )


def _head(room):
    """Return the first sentence of the docstring of a room."""
    text = ast.get_docstring(ast.parse((_folder(room) / "__init__.py").read_text(encoding="utf-8"))) or ""
    return " ".join(text.split("\n\n")[0].split())


def _folder(room):
    return PACKAGE.joinpath(*room.split("."))


def _dotted(path):
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def as_rst(lines):
    """Return a docstring, written as plain text with code in single backticks, as what Sphinx reads.

    A paragraph with a line that is set in by four is a formula or a drawing; nothing in it, nor in an example, is
    markup.
    """
    made = []
    for paragraph in re.split(r"\n\s*\n", "\n".join(lines)):
        part = paragraph.splitlines()
        drawn = any(line.startswith("    ") for line in part) and not paragraph.lstrip().startswith(("- ", "* "))
        if paragraph.startswith(">>> "):
            made += [*part, ""]
        elif drawn:
            made += ["::", "", *(f"    {line}" for line in part), ""]
        else:
            made += [*map(_escaped, part), ""]
    return made


def _escaped(line):
    pieces = re.split(r"(`[^`]+`)", line)
    return "".join(
        f"`{piece}`" if piece.startswith("`") else re.sub(r"([*|\\]|(?<=\w)_(?!\w))", r"\\\1", piece)
        for piece in pieces
    )


def _process(app, what, name, thing, options, lines):
    lines[:] = as_rst(lines)


def _write_pages(app):
    FOLDER.mkdir(exist_ok=True)
    for page in FOLDER.glob("*.md"):
        if page.stem not in ROOMS:
            page.unlink()
    for room in ROOMS:
        page, text = FOLDER / f"{room}.md", room_page(room)
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def setup(app):
    """Write the rooms' pages before the pages are read, and make their docstrings readable to Sphinx."""
    app.add_domain(FindsOnce, override=True)
    app.connect("config-inited", lambda app, config: _write_pages(app))
    app.connect("source-read", _list_rooms, priority=100)
    app.connect("autodoc-process-docstring", _process)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""The site's reference of the Python API, from its docstrings: a page for each chapter of `tt`, one for each room that
a program builds on.
"""

import ast
import inspect
import re
from importlib import import_module
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike
from sphinx.domains.python import PythonDomain

import tactuator
from tactuator.api.option import option_in
from tactuator.cli.commands import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "tactuator"
FOLDER = ROOT / "docs" / "python"
LISTED_IN = "docs/reference"  # two clicks from the start page
#: What a program of a laboratory calls, or a package of its own builds on; the rest is read in the source.
ROOMS = (
    "signals", "perception", "model", "io", "rig", "speech", "experiment.procedure", "experiment.task",
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


def chapters():
    """Return the functions of each chapter, by the page's name: `tt`'s chapters, and the commands beside them."""
    pages = {f"tt-{name}": [f"tactuator.{each}" for each in sum(of.values(), ())] for name, of in tactuator._CHAIN}
    named = {f"{module}:{name}" for _, of in tactuator._CHAIN for module, names in of.items() for name in names}
    others = [command.place for command in COMMANDS.values() if command.place not in named]
    return pages | {"tt-other": [f"tactuator.{place.replace(':', '.')}" for place in others]}


def chapter_page(name, functions):
    """Return the page of one chapter."""
    chapter = name.removeprefix("tt-")
    lines = [f"# {'Other commands as functions' if chapter == 'other' else f'tt: {chapter}'}", ""]
    for function in functions:
        is_class = isinstance(_thing(function), type)
        directive = [f".. autoclass:: {function}", "   :no-index:"] if is_class else [f".. autofunction:: {function}"]
        lines += ["```{eval-rst}", *directive, "```", ""]
    return "\n".join(lines)


def _thing(dotted):
    module, _, name = dotted.rpartition(".")
    return getattr(import_module(module), name)


def _list_rooms(app, page, source):
    if page == LISTED_IN:
        names = [
            f"- [{name.replace('tt-', 'tt: ')}](python/{name}.md): "
            + ", ".join(f"`{each.rpartition('.')[2]}`" for each in functions)
            for name, functions in chapters().items()
        ]
        names += [f"- [`tactuator.{room}`](python/{room}.md): {_head(room)}" for room in ROOMS]
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
        f"`{piece}`" if piece.startswith("`") else re.sub(r"([*|\\]|(?<=\w)_(?!\w)|-(?=-))", r"\\\1", piece)
        for piece in pieces
    )


def _process(app, what, name, thing, options, lines):
    lines[:] = as_rst(lines)
    if what == "function":
        hints = _hints(thing, extras=True)
        given = {each: option_in(hints[each]) for each in inspect.signature(thing).parameters if each in hints}
        lines += [f":param {each}: {_escaped(option.help)}" for each, option in given.items() if option is not None]


def _signature(app, what, name, thing, options, signature, answers):
    """Return a signature with the types without marks and modules."""
    if what not in ("function", "method", "class"):
        return None
    try:
        shape = inspect.signature(thing)
    except (ValueError, TypeError):  # of a class in C
        return None
    hints = _hints(thing)
    shown = [
        each.replace(annotation=_Named(_short(hints[key])) if key in hints else each.empty, default=_default(each))
        for key, each in shape.parameters.items()
        if key != "self" or what == "class"
    ]
    answer = f" -> {_short(hints['return'])}" if "return" in hints and what != "class" else ""
    written = str(shape.replace(parameters=shown, return_annotation=shape.empty))
    return written, answer.removeprefix(" -> ") or None


def _default(parameter):
    """Return a default as a person writes it: what is made by a function, or is one without a name, as `...`."""
    name = getattr(parameter.default, "__name__", "")
    if parameter.default is parameter.empty or not (name or repr(parameter.default) == "<factory>"):
        return parameter.default
    return _Named("..." if name in ("", "<lambda>") else name)


def _hints(thing, extras=False):
    """Return the types of a function's parameters, or of a class's fields; none where a name is not there to read."""
    try:
        return get_type_hints(thing, include_extras=extras)
    except NameError:  # imported for the type checker alone
        return {}


def _skip(app, what, name, thing, skip, options):
    """Skip the alias of a type with its bounds: they stand where it is used."""
    return True if get_origin(thing) is Annotated else None


class _Named:
    """An annotation that is written as its name."""

    def __init__(self, name):
        self.name = name

    def __repr__(self):
        return self.name


def _short(hint):
    """Return a type as a person writes it."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint == ArrayLike:
        return "array_like"
    if origin is np.ndarray:
        return f"ndarray[{_short(get_args(inner[1])[0])}]"
    if isinstance(hint, list):
        return f"[{', '.join(map(_short, hint))}]"
    if hint is NoneType or hint is None:
        return "None"
    if hint is Any:
        return "Any"
    if origin in (Union, UnionType):
        return " | ".join(dict.fromkeys(map(_short, inner)))
    if origin is Literal:
        return " | ".join(map(repr, inner))
    if origin is not None and inner:
        name = getattr(origin, "__name__", str(origin))
        return "path" if name == "PathLike" else f"{name}[{', '.join(map(_short, inner))}]"
    return "..." if hint is Ellipsis else getattr(hint, "__name__", str(hint).rpartition(".")[2])


def _write_pages(app):
    FOLDER.mkdir(exist_ok=True)
    pages = {room: room_page(room) for room in ROOMS}
    pages |= {name: chapter_page(name, functions) for name, functions in chapters().items()}
    for page in FOLDER.glob("*.md"):
        if page.stem not in pages:
            page.unlink()
    for name, text in pages.items():
        page = FOLDER / f"{name}.md"
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def setup(app):
    """Write the pages before they are read, and make docstrings and signatures readable to Sphinx."""
    app.add_domain(FindsOnce, override=True)
    app.connect("config-inited", lambda app, config: _write_pages(app))
    app.connect("source-read", _list_rooms, priority=100)
    app.connect("autodoc-process-docstring", _process)
    app.connect("autodoc-process-signature", _signature)
    app.connect("autodoc-skip-member", _skip)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

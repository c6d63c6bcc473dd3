"""What a verb's signature tells of a parameter beyond its type: its sentence, its bounds, and whether it is a file.

    poles: Annotated[int | None, Option("Poles of the prefilters.", ge=2, le=16)] = None

A parameter without such a mark is for Python alone. The default is that of the signature; `shell` is the command line's
where it differs (a file is written by default, say).
"""

import ast
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from tactuator.model.controller import Controller
    from tactuator.model.description import Display
    from tactuator.rig.rig import Rig


Place = str | PathLike[str]
AS_IN_PYTHON: Any = object()
"""The default of the command line is that of the signature."""


@dataclass(frozen=True)
class Option:
    """An option of the command line.

    help: its sentence. names: its spellings (none: that of the parameter). ge, le: bounds. metavar: what stands for the
    value in the help. file: True for a file or folder that must be there, writes: for one that is written. type: that
    of the command line, where a Python caller may give more. shell: the default of the command line.
    """

    help: str
    names: tuple[str, ...] = ()
    ge: float | None = None
    le: float | None = None
    metavar: str | None = None
    file: bool = False
    writes: bool = False
    type: Any = None
    shell: Any = AS_IN_PYTHON


@dataclass(frozen=True)
class Argument(Option):
    """An argument of the command line: it is known by its place."""


DISPLAY_HELP = "Display file; a controller is designed for it if none is given."
CONTROLLER_HELP = "Controller file that `design` wrote."
RIG_HELP = "simulated, in-process, emulated:BOARD, board:URL, sound:DEVICE."

Seed = Annotated[int, Option("Seed of all randomness; the same seed, the same result.", ge=0)]
DisplayOption = Annotated["Display | Place | None", Option(DISPLAY_HELP, file=True)]
ControllerOption = Annotated["Controller | Place | None", Option(CONTROLLER_HELP, file=True, shell=None)]
Figures = Annotated[Place | None, Option("Folder for the figures (SVG, and their numbers as CSV).", writes=True)]
RigOption = Annotated["Rig | str", Option(RIG_HELP, type=str, shell="simulated")]
Lsl = Annotated[bool, Option("Tell onsets, levels and answers by Lab Streaming Layer.")]
Channels = Annotated[Sequence[str] | None, Option("Channel (default: all).", ("--channel",), type=list[str] | None)]
Load = Annotated[str, Option("Load of the display file, or none.")]
MainsHz = Annotated[float | None, Option("Mains frequency; 0 for none.")]
Curve = Annotated["Any", Option("Threshold curve: a name, or a CSV.", type=str | None)]
Host = Annotated[str, Option("Address to listen at; another than loopback lets others in.")]
AllowedHosts = Annotated[
    list[str] | None,
    Option("Host name to answer to beside the own ones (of a proxy); repeatable.", ("--allowed-host",), metavar="NAME"),
]
TlsCertificate = Annotated[
    Place | None, Option("Certificate file (PEM) for an encrypted connection; with --tls-key.", type=str | None)
]
TlsKey = Annotated[Place | None, Option("Key file (PEM) of the certificate, without a password.", type=str | None)]


_HOUSE = Path(__file__).resolve().parents[1]


@cache
def _source(module: str) -> str:
    return (_HOUSE / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")


def sentence_of(place: str) -> str:
    """Return the first sentence of the docstring of a function, "module:function" below tactuator."""
    module, _, name = place.partition(":")
    docstring = _source(module).partition(f"\ndef {name}(")[2].partition('    """')[2]
    return re.split(r"\.\s|\"\"\"", docstring, maxsplit=1)[0].removesuffix(".") + "."


def constant(module: str, name: str) -> Any:
    """Return a constant of a module."""
    return ast.literal_eval(_source(module).partition(f"\n{name} = ")[2].partition("\n")[0])


class Fields:
    """The fields of a dataclass, "module:Class" below tactuator: the default of each, and its sentence."""

    def __init__(self, place: str) -> None:
        module, _, name = place.partition(":")
        text = f"class {name}:" + _source(module).partition(f"\nclass {name}:")[2]
        (declared,) = ast.parse(re.split(r"\n    def |\n\n\n", text, maxsplit=1)[0]).body
        assert isinstance(declared, ast.ClassDef)
        self._fields: Mapping[str, ast.AnnAssign] = {
            node.target.id: node
            for node in declared.body
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
        }

    def default(self, name: str) -> Any:
        """Return the default of a field."""
        value = self._fields[name].value
        assert value is not None
        return ast.literal_eval(value)

    def option(self, name: str, *names: str, **more: Any) -> Option:
        """Return the option that a field is, with its sentence; names, more: as for `Option`."""
        words = (node for node in ast.walk(self._fields[name].annotation) if isinstance(node, ast.keyword))
        sentence = next(ast.literal_eval(node.value) for node in words if node.arg == "description")
        return Option(sentence, names, **more)

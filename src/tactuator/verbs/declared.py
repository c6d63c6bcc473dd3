"""What lower rooms and verbs declare, read from their source: a help is shown before NumPy would be imported."""

import ast
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from tactuator.verbs.parameters import Option

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

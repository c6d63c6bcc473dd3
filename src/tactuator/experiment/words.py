"""Words by their key, from a language file (shipped, or a laboratory's), and the dictionary of exported columns."""

from __future__ import annotations

import csv
import string
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from tactuator.errors import BadInput
from tactuator.io.text import parse_toml, read_text

_SOURCE_LANGUAGE = "en"
_RIGHT_TO_LEFT = frozenset(("ar", "arc", "ckb", "dv", "fa", "he", "ps", "sd", "syr", "ug", "ur", "yi"))
"""Languages that are written from right to left in their usual script."""
_TEXT_LENGTH_MAX = 400
_KEYS_TOLD = 5


@dataclass(frozen=True)
class Words:
    """Texts of pages in one language.

    language: its tag (BCP 47), as a page's `lang`. texts: by key; a {name} in a text marks a value that is put in.
    """

    language: str
    texts: Mapping[str, str]

    @property
    def direction(self) -> str:
        """Return the direction in which the language is written, as a page's `dir`: "rtl" or "ltr"."""
        parts = self.language.lower().split("-")
        return "rtl" if parts[0] in _RIGHT_TO_LEFT or {"arab", "hebr"} & set(parts[1:2]) else "ltr"

    def __call__(self, key: str, /, **values: object) -> str:
        """Return the text of that key with the values put in. Raises KeyError for a key that no file has."""
        return self.texts[key].format_map({name: str(value) for name, value in values.items()})


def shipped_languages() -> tuple[str, ...]:
    """Return the tags of the languages that come with the package, in order."""
    folder = files("tactuator.experiment").joinpath("language")
    return tuple(sorted(file.name.removesuffix(".toml") for file in folder.iterdir() if file.name.endswith(".toml")))


@cache
def shipped_words(language: str) -> Words:
    """Return the words of a language that comes with the package; BadInput for another."""
    if language not in shipped_languages():
        raise BadInput(f"language {language!r}", f"{', '.join(shipped_languages())}, or a language_file of one's own")
    text = files("tactuator.experiment").joinpath("language").joinpath(f"{language}.toml").read_text(encoding="utf-8")
    return Words(language, _flat(tomllib.loads(text)))


def read_words(path: Path, language: str) -> Words:
    """Return the words of a language file, which has the keys of the shipped ones and the same names in each text.

    Raises BadInput for a file that cannot be read or lacks a key, has one too many, or puts in other names.
    """
    try:
        texts = _flat(parse_toml(read_text(path)))
    except RecursionError:
        raise BadInput(f"language file {path}: tables too deep", "TOML as the shipped files are") from None
    except BadInput as error:
        raise BadInput(f"language file {path}: {error}", "TOML as the shipped files are") from None
    amiss = difference(texts, shipped_words(_SOURCE_LANGUAGE).texts)
    if amiss is not None:
        raise BadInput(f"language file {path}: {amiss}")
    return Words(language, texts)


def difference(texts: Mapping[str, str], source: Mapping[str, str]) -> str | None:
    """Return in one line why `found` cannot replace `source`, or None if it can."""
    missing, beyond = sorted(set(source) - set(texts)), sorted(set(texts) - set(source))
    if missing or beyond:
        return f"keys missing: {_few(missing)}; beyond: {_few(beyond)}; expected the same"
    for key, text in texts.items():
        wanted, got = _names(source[key]), _names(text)
        if got != wanted:
            return f"{key} puts in {_listed(got)}; expected {_listed(wanted)}"
        if not 0 < len(text) <= _TEXT_LENGTH_MAX:
            return f"{key} has {len(text)} characters; expected 1 to {_TEXT_LENGTH_MAX}"
    return None


def _few(keys: Sequence[str]) -> str:
    more = f" and {len(keys) - _KEYS_TOLD} more" if len(keys) > _KEYS_TOLD else ""
    return ", ".join(keys[:_KEYS_TOLD]) + more if keys else "none"


def _listed(names: set[str]) -> str:
    return ", ".join(sorted(names)) or "nothing"


def _names(text: str) -> set[str]:
    try:
        return {name for _, name, _, _ in string.Formatter().parse(text) if name is not None}
    except ValueError:
        return {"a brace without its partner"}


def _flat(document: Mapping[str, object], prefix: str = "") -> dict[str, str]:
    """Return the texts of nested tables by their joined keys, {"page.done": ...}; other values become strings."""
    flat: dict[str, str] = {}
    for key, value in document.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": str(value)}
    return flat


class Column(NamedTuple):
    """A column of an exported table. source: its SQL, empty where it is computed."""

    table: str
    name: str
    source: str
    unit: str
    description: str


def _dictionary() -> dict[str, tuple[Column, ...]]:
    text = files("tactuator.experiment").joinpath("dictionary.csv").read_text("utf-8")
    columns = [Column(*row) for row in csv.reader(text.splitlines()[1:])]
    return {name: tuple(c for c in columns if c.table == name) for name in dict.fromkeys(c.table for c in columns)}


COLUMNS: Mapping[str, tuple[Column, ...]] = _dictionary()
"""The dictionary: columns by their table, each with meaning, unit and, where it is read from the store, its SQL:
the query and the description cannot disagree.
"""

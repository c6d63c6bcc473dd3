"""Text files that others wrote: their encoding and limits; JSON and TOML."""

from __future__ import annotations

import codecs
import json
import os
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactuator.errors import BadInput, reason_of

LARGEST_BYTES = 12 << 20
"""Size of a text file that is read as a whole: its cells or tables take up to fifty times as much memory. Records are
read in pieces and may be longer."""
_LARGEST_TOML = 2 << 20
_DEEP_KEY = re.compile(r"""(?:\.[ \t]*+(?:[\w-]{0,64}+|"[^"\n]{0,64}+"|'[^'\n]{0,64}+')[ \t]*+){64}""")
"""A key of so many parts takes the reader of TOML time and memory by the square of their number. Nothing is given back:
between points with spaces, as in a comment, there would be two ways for each."""
_TOML_KEY = re.compile(r"\('.*\)|(?<=key )'.*'")
"""The keys of the text that a refusal of the reader repeats."""
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))


def encoding_of(head: bytes) -> str:
    """Return the encoding by a file's first bytes: by a byte-order mark, by the zeros of UTF-16, or UTF-8."""
    for mark, name in _MARKS:
        if head.startswith(mark):
            return name
    pairs = head[: len(head) // 2 * 2]
    if pairs and not any(pairs[1::2]):
        return "utf-16-le"
    return "utf-16-be" if pairs and not any(pairs[::2]) else "utf-8"


def read_content(path: Path) -> bytes:
    """Return the bytes of a file. A pipe without a writer is empty: it is not waited for.

    Raises BadInput, with the reason alone, for a file that cannot be read or is larger than 12 MB.
    """
    try:
        with open(path, "rb", opener=_not_waiting) as file:
            content = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise BadInput(reason_of(error)) from None
    except ValueError:  # a NUL in its name
        raise BadInput("no file has such a name") from None
    if len(content) > LARGEST_BYTES:
        raise BadInput(f"it has more than {LARGEST_BYTES >> 20} MB")
    return content


def _not_waiting(path: str, flags: int) -> int:
    handle = os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
    if hasattr(os, "O_NONBLOCK"):
        os.set_blocking(handle, True)  # what is there is read to its end
    return handle


def read_text(path: Path) -> str:
    """Return the text of a file without its byte-order mark.

    Raises BadInput, with the reason alone, as `read_content` and for what is no text.
    """
    return text_of(read_content(path))


def text_of(content: bytes) -> str:
    """Return the text that a file's bytes are, as `read_text`."""
    try:
        return content.decode(encoding_of(content[:64])).replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise BadInput("it is not text") from None


def read_finite_json(path: Path) -> Any:
    """Return the content of a JSON file without NaN or infinities. Raises BadInput, the reason alone, otherwise."""
    return parse_finite_json(read_text(path))


def parse_finite_json(text: str) -> Any:
    """Return the content of a JSON text without NaN or infinities. Raises BadInput, the reason alone, otherwise."""
    try:
        return json.loads(text, parse_constant=_refused, parse_float=_finite)
    except BadInput:
        raise
    except (ValueError, RecursionError):
        raise BadInput("it is not JSON") from None


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text. Raises BadInput within its line for none, and for one of over 2 MB.

    A refusal says where, and nothing of the text: it may be another file than the reader was to see.
    """
    if len(text) > _LARGEST_TOML:
        raise BadInput(f"it has more than {_LARGEST_TOML >> 20} MB")
    if _DEEP_KEY.search(text):
        raise BadInput("it has a key of more than 64 parts")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        reason, _, place = str(error).splitlines()[0].removesuffix(")").rpartition(" (at ")  # all that it says
        reason = _TOML_KEY.sub("a key", reason)
        raise BadInput(reason or place, where=(place,) if reason else ()) from None
    except (ValueError, RecursionError):  # a number of thousands of digits, brackets thousands deep
        raise BadInput("it is not TOML") from None


def require_inside(value: Any, folder: Path, *where: str) -> None:
    """Raise BadInput for a text anywhere in a document that, as a path from the folder, leads out of it.

    Whether there is such a file makes no difference, and nothing of it is read.
    """
    if isinstance(value, Mapping):
        for key, each in value.items():
            require_inside(each, folder, *where, str(key))
    elif isinstance(value, list):
        for each in value:
            require_inside(each, folder, *where)
    elif (
        isinstance(value, str) and "\0" not in value and not (folder / value).resolve().is_relative_to(folder.resolve())
    ):
        raise BadInput(repr(value)[:60], "a path within its file's folder", where=where[:-1], key=where[-1])


def toml_text(document: Mapping[str, Any]) -> str:
    """Return a document as TOML: its values, its tables and its lists of tables; what is None is left out.

    Tables within those are written in line.
    """
    tables: list[tuple[str, Mapping[str, Any]]] = []
    values: dict[str, Any] = {}
    for key, value in document.items():
        if isinstance(value, Mapping):
            tables.append((f"[{key}]", value))
        elif isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
            tables += [(f"[[{key}]]", row) for row in value]
        else:
            values[key] = value
    blocks = ["\n".join(_toml_keys(values))] if values else []
    blocks += ["\n".join([head, *_toml_keys(table)]) for head, table in tables]
    return "\n\n".join(blocks) + "\n"


def _toml_keys(table: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {_toml_value(value)}" for key, value in table.items() if value is not None]


def _toml_value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_toml_keys(value)) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(item) for item in value) + "]"
    return json.dumps(value, ensure_ascii=False)  # numbers, truth values and strings are spelt as in JSON


def _refused(name: str) -> float:
    raise BadInput(f"it holds {name}", "finite numbers")


def _finite(digits: str) -> float:
    value = float(digits)
    if value in (float("inf"), float("-inf")):
        raise BadInput(f"it holds {digits}", "numbers up to 1.8e308")
    return value

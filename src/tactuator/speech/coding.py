"""A coding: a way from speech to signals, and from signals to fingers; by its name, or from a TOML file.

Codings are entry points of the group `tactuator.codings`: each refers to a frozen dataclass whose fields are its keys
and whose `kind` is the entry point's name, or to one such coding whose keys are set. A file holds every parameter: what
is not said is refused, not assumed.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Any, Protocol, get_args, get_type_hints, runtime_checkable

import numpy as np
from pydantic import TypeAdapter, ValidationError

from tactuator.arrays import FloatArray
from tactuator.entry_points import plugin, plugins
from tactuator.errors import BadInput, unknown, within
from tactuator.io.atomic import write_text
from tactuator.io.kinds import require_kind
from tactuator.io.text import parse_toml, read_text, toml_text
from tactuator.speech.options import CODING

GROUP = "tactuator.codings"


@runtime_checkable
class Coding(Protocol):
    """A way from speech to signals, and from signals to fingers."""

    @property
    def kind(self) -> str:
        """Return the kind of coding: direct, bands or envelope."""
        ...

    def signals(self, blocks: Iterator[FloatArray], rate_in_hz: int, rate_hz: int) -> Iterator[FloatArray]:
        """Yield mono blocks (n,) as blocks (m, signals) at the display's rate."""
        ...

    def placement(self, fingers: tuple[str, ...]) -> FloatArray:
        """Return the gain of each signal on each finger, shape (signals, fingers)."""
        ...


class CodingStream(Protocol):
    """A coding at work on a live signal: causal, block by block.

    rate_in_hz: of the sound that it takes, a multiple of the display's rate. delay_s: at frequencies that are felt,
    hertz, by how much they follow the sound, seconds.
    """

    @property
    def rate_in_hz(self) -> int: ...  # noqa: D102

    @property
    def delay_s(self) -> Mapping[float, float]: ...  # noqa: D102

    def push(self, block: FloatArray) -> FloatArray:
        """Return a mono block (n,) as (block, signals) at the display's rate."""
        ...


@runtime_checkable
class LiveCoding(Coding, Protocol):
    """A coding that works live as well."""

    def live(self, rate_hz: int, block: int) -> CodingStream:
        """Return the coding at work, from silence, for a display at that rate that plays blocks of `block` samples."""
        ...


def live_coding(coding: Coding) -> LiveCoding:
    """Return a coding that works live. Raises BadInput for one that does not state its delay: it looks ahead."""
    if not isinstance(coding, LiveCoding):
        raise BadInput(
            f"coding {coding.kind!r} cannot be causal: it has no `live` that states its delay",
            "direct, bands, envelope, or another that has it; `render` takes this one from a file",
        )
    return coding


def stated_delay(coding: Coding, stream: CodingStream) -> Mapping[float, float]:
    """Return the delay that a coding at work states. Raises BadInput for one that states none, or no time."""
    stated = getattr(stream, "delay_s", None)
    if not isinstance(stated, Mapping) or not stated or not all(0.0 <= late_s < np.inf for late_s in stated.values()):
        allowed = "a `delay_s` of one delay or more: seconds, by the frequency that is felt"
        raise BadInput(f"coding {coding.kind!r} states no delay: its delay_s is {stated!r}", allowed)
    return stated


def place(wanted: list[tuple[str, ...]], fingers: tuple[str, ...]) -> FloatArray:
    """Return ones and zeros, shape (signals, fingers): signal i goes to the fingers wanted[i]. Raises BadInput for a
    finger that is not there.
    """
    matrix = np.zeros((len(wanted), len(fingers)))
    for row, names in zip(matrix, wanted, strict=True):
        for name in fingers if "all" in names else names:
            if name not in fingers:
                raise BadInput(f"finger {name!r} is not on the display", f"all, {', '.join(fingers)}")
            row[fingers.index(name)] = 1.0
    return matrix


def coding_names() -> tuple[str, ...]:
    """Return the names of the codings that there are, the one that is usual first."""
    return tuple(sorted(plugins(GROUP), key=lambda name: (name != CODING, name)))


def coding_of(name_or_path: str) -> Coding:
    """Return a coding by its name, or from a file ending in .toml. Raises BadInput for neither, or for a file that is
    not one.
    """
    if name_or_path in plugins(GROUP):
        declared = plugin(GROUP, name_or_path)
        coding = declared() if isinstance(declared, type) else declared
        if not isinstance(coding, Coding):
            raise BadInput(f"{name_or_path!r} refers to {declared!r}", "a coding", where=(GROUP,))
        return coding
    if not name_or_path.endswith(".toml"):
        require_kind(Path(name_or_path), "coding")
        raise unknown("coding", name_or_path, [*coding_names(), "a file ending in .toml"])
    return read_coding(Path(name_or_path))


def read_coding(path: Path) -> Coding:
    """Read a coding; BadInput, one line, for a file that cannot be read or lacks, doubles or mistypes a parameter."""
    require_kind(path, "coding")
    with within(f"coding file {path}"):
        return parse_coding(parse_toml(read_text(path)))


def parse_coding(document: Mapping[str, Any]) -> Coding:
    """Return the coding of a document with every parameter in it."""
    kind = document.get("kind")
    declared = plugin(GROUP, kind) if isinstance(kind, str) and kind in plugins(GROUP) else None
    if not isinstance(declared, type):
        kinds = [name for name in coding_names() if isinstance(plugin(GROUP, name), type)]
        raise BadInput(repr(kind), ", ".join(kinds), key="kind")
    whole = _whole(declared, document, ())
    try:
        coding: Coding = TypeAdapter(declared).validate_json(json.dumps(whole, default=str), strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        refused = first.get("ctx", {}).get("error")
        if isinstance(refused, BadInput):
            raise refused.within(*(str(part) for part in first["loc"])) from None
        *where, key = (str(part) for part in first["loc"])
        raise BadInput(repr(first["input"]), first["msg"], where=tuple(where), key=key) from None
    return coding


def _whole(cls: type[Any], document: Any, where: tuple[str, ...]) -> dict[str, Any]:
    """Return the table of a dataclass with every key in it, tables within it as well. What may be none may be left
    out, since TOML has no null (a high-pass has no upper edge).
    """
    if not isinstance(document, Mapping):
        raise BadInput(f"{document!r}", "a table", where=where)
    hints = get_type_hints(cls)
    names = [field.name for field in fields(cls)]
    for key in document:
        if key not in names:
            raise BadInput(f"{key!r} is not a parameter", ", ".join(names), where=where)
    values = {name: None for name in names if NoneType in get_args(hints[name])} | dict(document)
    for name in names:
        if name not in values:
            raise BadInput(f"{name!r} is missing", "a file with every parameter in it", where=where)
        inner = [part for part in get_args(hints[name]) if isinstance(part, type) and is_dataclass(part)]
        if isinstance(hints[name], type) and is_dataclass(hints[name]):
            values[name] = _whole(hints[name], values[name], (*where, name))
        elif inner and isinstance(values[name], list):
            values[name] = [_whole(inner[0], row, (*where, f"{name}[{at}]")) for at, row in enumerate(values[name])]
    return values


def coding_document(coding: Coding) -> dict[str, Any]:
    """Return plain tables with every parameter, from which `parse_coding` makes an equal coding."""
    document: dict[str, Any] = _without_none(asdict(coding))  # type: ignore[call-overload]
    return document


def _without_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list | tuple) else value


def write_coding(path: str | Path, coding: Coding) -> None:
    """Write a coding as TOML, every parameter in it: a place to start one's own from."""
    write_text(path, toml_text(coding_document(coding)), "coding")

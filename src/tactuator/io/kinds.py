"""The kinds of files, each known by its content, and the sentence that points a file of another kind onwards."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactuator.errors import BadInput, within
from tactuator.io.hdf5 import opened_hdf5
from tactuator.io.text import encoding_of, parse_toml, read_finite_json


@dataclass(frozen=True)
class Kind:
    """One kind of file: its words, and what takes it."""

    words: str
    goes: str


KINDS: Mapping[str, Kind] = {
    "display": Kind("a display file", "`tactuator design` takes it"),
    "record": Kind("a record", "`tactuator identify` takes it"),
    "response": Kind("a frequency response", "`tactuator identify` takes it, and a display file may name it as plant"),
    "measured": Kind("a measured response", "`tactuator measure response` wrote it; `tt.read_responses` reads it"),
    "model": Kind("a model", "a display file names it as plant (`tactuator init --from` writes one)"),
    "controller": Kind("a controller", "`tactuator check`, `build` and `measure` take it"),
    "image": Kind("an image", "`tactuator firmware image` says what it is"),
    "reference": Kind("a reference", "`tactuator play` takes it"),
    "sound": Kind("a sound file", "`tactuator render` takes speech, `identify` a record in two channels"),
    "protocol": Kind("a protocol", "`tactuator experiment serve` takes it"),
    "store": Kind("the store of an experiment", "`tactuator experiment thresholds --store` takes it"),
    "curve": Kind("a threshold curve", "a display file names it as curve, or `tactuator design --curve`"),
    "contours": Kind("equal-strength contours", "a display file names them under [strength]"),
    "loss": Kind("a curve in dB SL", "`tactuator experiment simulate --truth` takes it"),
    "pairs": Kind("the pairs of a calibration", "`tactuator calibrate` takes them"),
    "environment": Kind("a measured environment", "a display file names it as measured under [environment]"),
    "matrix": Kind("a confusion matrix", "`tactuator experiment information --matrix` takes it"),
    "coding": Kind("a coding of speech", "`tactuator render --coding` takes it"),
}
"""Kinds of files by name."""

STORE_MARK = b"SQLite format 3"
"""How the file of a store begins."""
_HEAD = 1 << 16
_FORMAT = re.compile(rb'"format"\s*:\s*"tactuator-(\w+)/')
_FORMATS = {name: name for name in ("record", "model", "controller", "reference", "environment")} | {
    "response": "measured"
}
_TABLES = {
    "display": {"display", "channel", "converter", "threshold", "feedback"},
    "protocol": {"study", "procedure", "conditions", "recognition", "item", "block"},
    "coding": {"bands", "kind"},
}
_COLUMNS = (
    ("measured", {"frequency_hz", "magnitude_v", "level_db_sl"}),
    ("curve", {"frequency_hz", "level_db_re_1um"}),
    ("curve", {"frequency_hz", "acceleration_m_s2_rms"}),
    ("contours", {"frequency_hz", "level_db_sl", "db_sl"}),
    ("loss", {"frequency_hz", "level_db_sl"}),
    ("response", {"frequency_hz"}),
    ("pairs", {"displacement_mm", "voltage_v"}),
    ("record", {"time_s"}),
    ("record", {"t"}),
    ("record", {"command_v"}),
)
"""Columns that determine a table's kind, the first that are all there."""
_SOUNDS = (b"RIFF", b"RF64", b"fLaC", b"OggS", b"FORM", b"riff")


def kind_of(path: Path) -> str | None:
    """Return the kind of a file by its content, or None if that does not show it (or cannot be read)."""
    try:
        if not path.is_file():
            return None
        with path.open("rb") as file:
            head = file.read(_HEAD)
        return _kind(path, head)
    except (OSError, BadInput):
        return None


def _kind(path: Path, head: bytes) -> str | None:
    if head.startswith(b"TACI"):
        return "image"
    if head.startswith(STORE_MARK):
        return "store"
    if head.startswith(b"\x89HDF"):
        return _kind_of_hdf5(path)
    if head.startswith(_SOUNDS):
        beside = path.with_suffix(".json")
        is_ours = b"tactuator reference" in head or (beside != path and kind_of(beside) == "reference")
        return "reference" if is_ours else "sound"
    if head.lstrip().startswith(b"{"):
        named = _FORMAT.search(head)
        return None if named is None else _FORMATS.get(named[1].decode())
    if b"\0" in head[:1000]:
        return None
    return _kind_of_text(path, head.decode(encoding_of(head[:64]), errors="replace"))


def _kind_of_hdf5(path: Path) -> str | None:
    with suppress(OSError, RuntimeError, ValueError, KeyError), opened_hdf5(path) as file:
        if "head" in file.attrs and "reference" in file:
            return "reference"
        named = re.match(r"tactuator-(\w+)/", str(file.attrs.get("format", "")))
        return None if named is None else _FORMATS.get(named[1])
    return None


def _kind_of_text(path: Path, text: str) -> str | None:
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        return None
    rows = [re.split(r"[,;\t]", line.lstrip("\ufeff")) for line in lines[:2]]
    cells = {cell.strip().strip("\"'").lower() for cell in rows[0]}
    kind = next((kind for kind, names in _COLUMNS if names <= cells), None)
    if kind is None and not rows[0][0] and len(rows) > 1 and rows[1][0] in rows[0][1:]:
        return "matrix"
    if kind is not None or len(text) >= _HEAD:
        return kind
    with suppress(BadInput):
        tables = set(parse_toml(text.lstrip("\ufeff")))
        return next((kind for kind, names in _TABLES.items() if names & tables), None)
    return None


def require_kind(path: Path, *wanted: str) -> None:
    """Raise BadInput for a file that is plainly of another kind than those `wanted`: what it is, and what takes it."""
    kind = kind_of(path)
    if kind is not None and kind not in wanted:
        is_ = KINDS[kind]
        allowed = " or ".join(KINDS[name].words for name in wanted)
        raise BadInput(f"this is {is_.words}: {is_.goes}", allowed, where=(f"{path}",))


def require_replaceable(path: Path, kind: str | None) -> None:
    """Raise BadInput where a file is there that is not one of that kind, or a store: it may be the only copy."""
    if not path.is_file() or path.stat().st_size == 0:
        return
    there = kind_of(path)
    if there != kind or kind == "store":
        words = "another file" if there is None else KINDS[there].words
        raise BadInput(
            f"{path} is {words} already", f"another name{'' if kind is None else f' for {KINDS[kind].words}'}"
        )


def read_document(path: Path, kind: str, form: str) -> dict[str, Any]:
    """Return the JSON document of a file of that kind, with that `format`. Raises BadInput for any other file."""
    require_kind(path, kind)
    with within(f"{kind} {path}"):
        content = read_finite_json(path)
        document: dict[str, Any] = content if isinstance(content, dict) else {}
        if document.get("format") != form:
            raise BadInput(repr(document.get("format")), repr(form), key="format")
    return document

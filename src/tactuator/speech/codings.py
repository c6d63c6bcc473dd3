"""Codings by name or from a TOML file. A file holds every parameter: what is not said is refused, not assumed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from tactuator.errors import BadInput
from tactuator.io.atomic import write_text
from tactuator.io.formats.text import parse_toml, read_text
from tactuator.speech.band_codings import BandsCoding, DirectCoding
from tactuator.speech.coding import Coding
from tactuator.speech.envelope_coding import PRESETS, EnvelopeBand, EnvelopeCoding, Voicing

NAMED: Mapping[str, Coding] = {"direct": DirectCoding(), "bands": BandsCoding(), **PRESETS}
KINDS: Mapping[str, type[Any]] = {"direct": DirectCoding, "bands": BandsCoding, "envelope": EnvelopeCoding}


def coding_of(name_or_path: str) -> Coding:
    """Return a coding by its name, or from a file ending in .toml. Raises BadInput for neither, or for a file that is
    not one.
    """
    if name_or_path in NAMED:
        return NAMED[name_or_path]
    if not name_or_path.endswith(".toml"):
        raise BadInput(f"coding {name_or_path!r} is not known", f"{', '.join(NAMED)}, or a file ending in .toml")
    return read_coding(Path(name_or_path))


def read_coding(path: Path) -> Coding:
    """Read a coding; BadInput, one line, for a file that cannot be read or lacks, doubles or mistypes a parameter."""
    try:
        document = parse_toml(read_text(path))
    except BadInput as error:
        raise BadInput(f"coding file {path}: {error}", "a TOML file that can be read") from None
    try:
        return parse_coding(document)
    except BadInput as error:
        raise error.within(f"coding file {path}") from None


def parse_coding(document: Mapping[str, Any]) -> Coding:
    """Return the coding of a document with every parameter in it."""
    kind = document.get("kind")
    if kind not in KINDS:
        raise BadInput(f"kind is {kind!r}", f"{', '.join(KINDS)}")
    _check_keys(document, KINDS[str(kind)], "")
    values = dict(document)
    if kind == "envelope":
        bands, voicing = values["bands"], values["voicing"]
        if not isinstance(bands, list) or not isinstance(voicing, Mapping):
            raise BadInput("bands and voicing", "[[bands]] tables and one [voicing] table")
        values["bands"] = tuple(_made(EnvelopeBand, _band(band, at), f"bands[{at}]") for at, band in enumerate(bands))
        _check_keys(voicing, Voicing, "voicing: ")
        values["voicing"] = _made(Voicing, voicing, "voicing")
        return EnvelopeCoding(**_scalars(values))
    made: Coding = _made(KINDS[str(kind)], values, str(kind))
    return made


def _band(band: Any, at: int) -> Mapping[str, Any]:
    if not isinstance(band, Mapping):
        raise BadInput(f"bands[{at}] is {band!r}", "a table")
    whole = {"high_hz": None, **band}  # TOML has no null: a high-pass leaves its upper edge out
    _check_keys(whole, EnvelopeBand, f"bands[{at}]: ")
    return whole


def _scalars(values: Mapping[str, Any]) -> dict[str, Any]:
    if not isinstance(values["name"], str) or not isinstance(values["analysis_hz"], int | float):
        raise BadInput("name and analysis_hz", "a word and a number")
    return {**values, "analysis_hz": float(values["analysis_hz"])}


def _check_keys(document: Mapping[str, Any], kind: type[Any], where: str) -> None:
    names = [field.name for field in fields(kind)]
    unknown = [key for key in document if key not in names]
    missing = [name for name in names if name not in document]
    if unknown:
        raise BadInput(f"{where}{unknown[0]!r} is not a parameter", f"{', '.join(names)}")
    if missing:
        raise BadInput(f"{where}{missing[0]!r} is missing", "a file with every parameter in it")


def _made(kind: type[Any], values: Mapping[str, Any], where: str) -> Any:
    """Return the dataclass of these values; their types and ranges are checked."""
    try:
        return TypeAdapter(kind).validate_python(dict(values))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in (where, *first["loc"]))
        raise BadInput(f"{place} is {first['input']!r}", f"{first['msg']}") from None


def coding_document(coding: Coding) -> dict[str, Any]:
    """Return plain tables with every parameter, from which `parse_coding` makes an equal coding."""
    document: dict[str, Any] = asdict(coding)  # type: ignore[call-overload]
    return {key: _without_none(value) for key, value in document.items()}


def _without_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value


def write_coding(path: str | Path, coding: Coding) -> None:
    """Write a coding as TOML, every parameter in it: a place to start one's own from."""
    document = coding_document(coding)
    plain = {key: value for key, value in document.items() if not _is_table(value)}
    lines = [f"{key} = {_toml(value)}" for key, value in plain.items()]
    for key, value in document.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{key}]", *(f"{name} = {_toml(item)}" for name, item in value.items())]
        elif _is_table(value):
            for entry in value:
                lines += ["", f"[[{key}]]", *(f"{name} = {_toml(item)}" for name, item in entry.items())]
    write_text(path, "\n".join(lines) + "\n")


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping) or (isinstance(value, list) and bool(value) and isinstance(value[0], Mapping))


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return repr(value)

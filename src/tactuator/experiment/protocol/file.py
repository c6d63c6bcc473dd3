"""Reading of protocol files (TOML) of either kind; the tables of a file say which kind it is."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from tactuator.errors import BadInput
from tactuator.experiment.protocol.protocol import Protocol
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.experiment.protocol.study import StudyProtocol
from tactuator.io.text import parse_toml, read_text

_P = TypeVar("_P", bound=StudyProtocol)
_RECOGNITION_TABLES = {"recognition", "item", "block"}
_KINDS: dict[type[StudyProtocol], str] = {
    Protocol: "a detection protocol (tables procedure, conditions)",
    RecognitionProtocol: "a recognition protocol (tables item, block)",
}


def read_any_protocol(path: str | Path) -> tuple[StudyProtocol, str]:
    """Return the protocol, a `Protocol` or an `RecognitionProtocol`, and the file's own text.

    Raises BadInput, in one line that names the key, for a file that is missing, not TOML, or says what is not allowed.
    """
    text = _text(path)
    document = _document(text, str(path))
    return _parsed(document, str(path), _kind(document)), text


def read_protocol(path: str | Path) -> tuple[Protocol, str]:
    """Return a detection protocol and the file's text. Raises BadInput as `read_any_protocol` and for another kind."""
    text = _text(path)
    return parse_protocol(text, str(path)), text


def read_recognition(path: str | Path) -> tuple[RecognitionProtocol, str]:
    """Return a recognition protocol and the file's text. Raises BadInput as `read_protocol`."""
    text = _text(path)
    return parse_recognition(text, str(path)), text


def parse_any_protocol(text: str, where: str = "protocol") -> StudyProtocol:
    """Return the protocol of either kind that the text describes. Raises BadInput as `read_any_protocol`."""
    document = _document(text, where)
    return _parsed(document, where, _kind(document))


def parse_protocol(text: str, where: str = "protocol") -> Protocol:
    """Return the detection protocol that the text describes. Raises BadInput as `read_protocol`."""
    return _of_kind(text, where, Protocol)


def parse_recognition(text: str, where: str = "protocol") -> RecognitionProtocol:
    """Return the recognition protocol that the text describes. Raises BadInput as `read_recognition`."""
    return _of_kind(text, where, RecognitionProtocol)


def protocol_hash(text: str) -> str:
    """Return the SHA-256 (hex) of the file's text."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def _text(path: str | Path) -> str:
    try:
        return read_text(Path(path))
    except BadInput as error:
        raise BadInput(f"protocol {path}: {error}", "a TOML file that can be read") from None


def _document(text: str, where: str) -> dict[str, Any]:
    try:
        return parse_toml(text)
    except BadInput as error:
        raise BadInput(f"protocol {where}: {error}", "TOML") from None


def _kind(document: dict[str, Any]) -> type[StudyProtocol]:
    return RecognitionProtocol if _RECOGNITION_TABLES & set(document) else Protocol


def _of_kind(text: str, where: str, form: type[_P]) -> _P:
    document = _document(text, where)
    if _kind(document) is not form:
        raise BadInput(f"protocol {where} has the tables {', '.join(document) or 'none'}", f"{_KINDS[form]}")
    return _parsed(document, where, form)


def _parsed(document: dict[str, Any], where: str, form: type[_P]) -> _P:
    try:
        return form.model_validate(document)
    except ValidationError as error:
        raise BadInput(f"protocol {where}: {_fault(error)}") from None


def _fault(error: ValidationError) -> str:
    """Return what is amiss first: what was got, and what is allowed."""
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "missing":
        return f"it lacks {key!r}; allowed: a file that has it"
    if first["type"] == "extra_forbidden":
        return f"{key!r} is no key that is known; allowed: those of the documents"
    message = first["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    got = "" if isinstance(first["input"], dict) else f" is {first['input']!r}; allowed"
    return f"{key}{got}: {message}" if key else message

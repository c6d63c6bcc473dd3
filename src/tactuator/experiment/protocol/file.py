"""Protocol files (TOML) of any kind, whose tables say which kind it is."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from tactuator.errors import BadInput
from tactuator.experiment.protocol.detection import Protocol as Protocol  # also for the study of the paper
from tactuator.experiment.protocol.judging import JudgingProtocol
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.experiment.protocol.study import StudyProtocol
from tactuator.io.kinds import require_kind
from tactuator.io.text import parse_toml, read_text
from tactuator.parameters import from_table

_P = TypeVar("_P", bound=StudyProtocol)
_KIND_OF: Mapping[str, type[StudyProtocol]] = {
    "task": JudgingProtocol, **dict.fromkeys(("recognition", "item", "block"), RecognitionProtocol),
}  # fmt: skip
"""Tables by which a protocol is known; one without any of them is of detection."""
_KINDS: Mapping[type[StudyProtocol], str] = {
    Protocol: "a detection protocol (tables procedure, conditions)",
    RecognitionProtocol: "a recognition protocol (tables item, block)",
    JudgingProtocol: "a protocol with a task (table task)",
}


def read_protocol(path: str | Path, form: type[_P]) -> tuple[_P, str]:
    """Return the protocol, of one of the kinds of `_KINDS`, and the file's own text. form: StudyProtocol for any kind.

    Raises BadInput, in one line that names the key, for a file that is missing, not TOML, says what is not allowed, or
    is of another kind.
    """
    require_kind(Path(path), "protocol")
    try:
        text = read_text(Path(path))
    except BadInput as error:
        raise BadInput(f"protocol {path}: {error}", "a TOML file that can be read") from None
    return parse_protocol(text, form, str(path)), text


def parse_protocol(text: str, form: type[_P], where: str = "protocol") -> _P:
    """Return the protocol that the text describes. Raises BadInput as `read_protocol`."""
    try:
        document = parse_toml(text)
    except BadInput as error:
        raise BadInput(f"protocol {where}: {error}", "TOML") from None
    kind = next((of for name, of in _KIND_OF.items() if name in document), Protocol)
    if not issubclass(kind, form):
        raise BadInput(f"protocol {where} has the tables {', '.join(document) or 'none'}", _KINDS[form])
    return from_table(kind, document, f"protocol {where}")


def protocol_hash(text: str) -> str:
    """Return the SHA-256 (hex) of the file's text."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()

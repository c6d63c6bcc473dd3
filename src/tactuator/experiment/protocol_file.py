"""Reads a protocol file (TOML)."""

from __future__ import annotations

import hashlib
import tomllib
from pathlib import Path

from pydantic import ValidationError

from tactuator.errors import BadInput
from tactuator.experiment.protocol import Protocol


def read_protocol(path: str | Path) -> tuple[Protocol, str]:
    """The protocol and the file's own text.

    Raises BadInput, in one line that names the key, for a file that is missing, not TOML, or says what is not allowed.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise BadInput(f"protocol {path}: {reason}; allowed: a TOML file that can be read") from None
    return parse_protocol(text, str(path)), text


def parse_protocol(text: str, where: str = "protocol") -> Protocol:
    """The protocol that the text says; BadInput as in `read_protocol`."""
    try:
        return Protocol.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"protocol {where}: {error}; allowed: TOML") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "file"
        got = "" if isinstance(first["input"], dict) else f" (got {first['input']!r})"
        raise BadInput(f"protocol {where}: {key}: {first['msg']}{got}") from None


def protocol_hash(text: str) -> str:
    """SHA-256 (hex) of the file's text."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()

"""Plain tables of a display, as they stand in controller.json, and the hash of such tables."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from tactuator.model.description import Channel, Display
from tactuator.parameters import parameters, plain
from tactuator.signals.systems import ContinuousSystem


def document_hash(document: dict[str, Any]) -> str:
    """Return SHA-256 (hex) of a document without its own hash, in canonical JSON."""
    bare = {key: value for key, value in document.items() if key != "hash"}
    text = json.dumps(bare, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def display_document(display: Display) -> dict[str, Any]:
    """Return the plain tables that `parse_display` turns into an equal display: curves with their points, plants as
    roots.
    """
    wires = () if display.sound is None else display.sound.wires
    card = {} if display.sound is None else {"sound": _own(display.sound)}
    channels = [_channel_document(channel) for channel in display.channels]
    for channel, wire in zip(channels, wires, strict=bool(wires)):
        channel |= plain(wire)
    touch = {"touch": plain(display.touch)} if display.touch.adaptive else {}
    return {
        "display": _own(display),
        "objectives": plain(display.objectives),
        **card,
        **touch,
        "channel": channels,
    }


def _own(table: Any) -> dict[str, Any]:
    """Return the keys that a table has in the file, without what other tables hold."""
    kind: type = type(table)
    return {key: plain(getattr(table, key)) for key in parameters(kind)}


_WHERE_SAID = ("covariance", "valid_hz", "model_error_db", "model_error_hz", "controller")
"""Keys of a channel that are left out where nothing is said."""


def _channel_document(channel: Channel) -> dict[str, Any]:
    given = channel.feedback.controller
    tables: dict[str, Any] = {
        **_own(channel),
        **plain(channel.converter),
        **plain(channel.threshold),
        **plain(channel.feedback),
        **plain(channel.prefilter),
        **plain(channel.environment),
        "plant": _system_document(channel.plant),
        "family": [_system_document(member) for member in channel.family],
        "controller": None if given is None else _system_document(given),
    }
    return {key: value for key, value in tables.items() if value or key not in _WHERE_SAID}


def _system_document(system: ContinuousSystem) -> dict[str, Any]:
    return {
        "zeros": [[root.real, root.imag] for root in system.zeros.tolist()],
        "poles": [[root.real, root.imag] for root in system.poles.tolist()],
        "gain": system.gain,
        "delay_s": system.delay_s,
    }

"""Plain tables of a display, as they stand in controller.json, and the hash of such tables."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from typing import Any

from tactuator.model.description import Channel, Display
from tactuator.model.sound_card import SoundCard
from tactuator.perception.curve import ThresholdCurve
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
    return {
        "display": {
            "name": display.name,
            "rate_hz": display.rate_hz,
            "delay_samples": display.delay_samples,
        },
        "objectives": asdict(display.objectives),
        **_sound_document(display.sound),
        **({"touch": asdict(display.touch)} if display.touch.adaptive else {}),
        "channel": [
            _channel_document(channel) | wires
            for channel, wires in zip(display.channels, _wire_documents(display), strict=True)
        ],
    }


def _sound_document(sound: SoundCard | None) -> dict[str, Any]:
    if sound is None:
        return {}
    return {"sound": {key: value for key, value in vars(sound).items() if key != "wires"}}


def _wire_documents(display: Display) -> list[dict[str, Any]]:
    return [{}] * len(display.channels) if display.sound is None else [asdict(one) for one in display.sound.wires]


def _channel_document(channel: Channel) -> dict[str, Any]:
    feedback = {key: value for key, value in vars(channel.feedback).items() if key != "controller"}
    if channel.feedback.controller is not None:
        feedback["controller"] = _system_document(channel.feedback.controller)
    return {
        "name": channel.name,
        "finger": channel.finger,
        "sensor_gain_v_per_mm": channel.sensor_gain_v_per_mm,
        "travel_mm": channel.travel_mm,
        "plant": _system_document(channel.plant),
        "quantity": channel.quantity,
        "loads": [asdict(load) for load in channel.loads],
        "family": [_system_document(member) for member in channel.family],
        **({"covariance": [list(row) for row in channel.covariance]} if channel.covariance else {}),
        **({"valid_hz": list(channel.valid_hz)} if channel.valid_hz else {}),
        **({"model_error_db": channel.model_error_db} if channel.model_error_db else {}),
        **({"model_error_hz": list(channel.model_error_hz)} if channel.model_error_hz else {}),
        **asdict(channel.converter),
        "curve": _curve_document(channel.threshold.curve),
        "band_hz": list(channel.threshold.band_hz),
        **{key: list(value) if isinstance(value, tuple) else value for key, value in feedback.items()},
        **asdict(channel.prefilter),
        **{key: list(v) if isinstance(v, tuple) else v for key, v in asdict(channel.environment).items()},
    }


def _system_document(system: ContinuousSystem) -> dict[str, Any]:
    return {
        "zeros": [[root.real, root.imag] for root in system.zeros.tolist()],
        "poles": [[root.real, root.imag] for root in system.poles.tolist()],
        "gain": system.gain,
        "delay_s": system.delay_s,
    }


def _curve_document(curve: ThresholdCurve) -> dict[str, Any]:
    errors = curve.standard_error_db
    return {
        "name": curve.name,
        "frequency_hz": curve.frequency_hz.tolist(),
        "level_db_re_1um": curve.level_db_re_1um.tolist(),
        "provenance": curve.provenance,
        "source": curve.source,
        "standard_error_db": None if errors is None else errors.tolist(),
    }

"""The file controller.json: a designed controller with the display it was designed for."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from tactuator import __version__
from tactuator.display.controller import AntiWindup, ChannelController, Controller, Limits
from tactuator.errors import BadInput
from tactuator.files.atomic import write_text
from tactuator.files.display import display_document, parse_display

FORMAT = "tactuator-controller/1"


def controller_document(controller: Controller) -> dict[str, Any]:
    """Return the document of controller.json, its hash included."""
    document: dict[str, Any] = {
        "format": FORMAT,
        "tool": controller.tool or __version__,
        "display": display_document(controller.display),
        "rate_hz": controller.rate_hz,
        "delay_samples": controller.delay_samples,
        "channels": [_channel_document(channel) for channel in controller.channels],
    }
    document["hash"] = _hash(document)
    return document


def controller_hash(controller: Controller) -> str:
    """Return SHA-256 (hex) of the document without its hash: what a response or an experiment records."""
    return str(controller_document(controller)["hash"])


def write_controller(path: str | Path, controller: Controller) -> None:
    """Write controller.json, whole or not at all."""
    write_text(path, json.dumps(controller_document(controller), indent=1) + "\n")


def read_controller(path: str | Path) -> Controller:
    """Read controller.json; BadInput, one line, if it is not one, or was changed by hand."""
    path = Path(path)
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not JSON"
        raise BadInput(f"controller {path}: {reason}; allowed: a file that `design` wrote") from None
    try:
        return parse_controller(document)
    except BadInput as error:
        raise BadInput(f"controller {path}: {error}") from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(f"controller {path}: {error!r} is amiss; allowed: a file that `design` wrote") from None


def parse_controller(document: dict[str, Any]) -> Controller:
    """Return the controller of a document. Raises BadInput for another format or a hash that does not fit."""
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        got = document.get("format") if isinstance(document, dict) else type(document).__name__
        raise BadInput(f"format is {got!r}; allowed: {FORMAT!r}")
    if document.get("hash") != _hash(document):
        raise BadInput("its hash does not fit its contents; allowed: a file as `design` wrote it")
    display = parse_display(document["display"])
    channels = tuple(_channel(entry) for entry in document["channels"])
    controller = Controller(display, channels, str(document["tool"]))
    controller.require_limits_of(display)
    return controller


def _hash(document: dict[str, Any]) -> str:
    bare = {key: value for key, value in document.items() if key != "hash"}
    text = json.dumps(bare, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _channel_document(channel: ChannelController) -> dict[str, Any]:
    feedback = channel.feedback_sos
    return {
        "name": channel.name,
        "threshold_voltage_dc": channel.threshold_voltage_dc,
        "prefilter_sos": channel.prefilter_sos.tolist(),
        "feedback_sos": None if feedback is None else feedback.tolist(),
        "anti_windup": {"gains": list(channel.anti_windup.gains)},
        "limits": dict(vars(channel.limits)),
        "designed_for": list(channel.designed_for),
        "report": dict(channel.report),
    }


def _channel(entry: dict[str, Any]) -> ChannelController:
    feedback = entry["feedback_sos"]
    first, second = entry["anti_windup"]["gains"]
    return ChannelController(
        entry["name"],
        float(entry["threshold_voltage_dc"]),
        np.asarray(entry["prefilter_sos"], dtype=np.float64),
        None if feedback is None else np.asarray(feedback, dtype=np.float64),
        AntiWindup((float(first), float(second))),
        Limits(**entry["limits"]),
        tuple(entry["designed_for"]),
        entry["report"],
    )

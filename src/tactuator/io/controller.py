"""The file controller.json: a designed controller with the display it was designed for."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from tactuator.errors import BadInput
from tactuator.io.atomic import write_text
from tactuator.io.display import parse_display
from tactuator.io.formats.text import read_json
from tactuator.model.controller import FORMAT, AntiWindup, ChannelController, Controller, Limits
from tactuator.model.document import document_hash
from tactuator.model.touch import FeedForward


def write_controller(path: str | Path, controller: Controller) -> None:
    """Write controller.json, whole or not at all."""
    write_text(path, controller_text(controller))


def controller_text(controller: Controller) -> str:
    """Return the text of controller.json."""
    return json.dumps(controller.document(), indent=1) + "\n"


def read_controller(path: str | Path) -> Controller:
    """Read controller.json; BadInput, one line, if it is not one, or was changed by hand."""
    path = Path(path)
    try:
        document = read_json(path)
    except BadInput as error:
        raise BadInput(f"controller {path}: {error}", "a file that `design` wrote") from None
    try:
        return parse_controller(document)
    except BadInput as error:
        raise error.within(f"controller {path}") from None
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise BadInput(f"controller {path}: {error!r} is amiss", "a file that `design` wrote") from None


def parse_controller(document: dict[str, Any]) -> Controller:
    """Return the controller of a document. Raises BadInput for another format or a hash that does not fit."""
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        got = document.get("format") if isinstance(document, dict) else type(document).__name__
        raise BadInput(f"format is {got!r}", f"{FORMAT!r}")
    if document.get("hash") != document_hash(document):
        raise BadInput("its hash does not fit its contents", "a file as `design` wrote it")
    display = parse_display(document["display"])
    channels = tuple(_channel(entry) for entry in document["channels"])
    controller = Controller(display, channels, str(document["tool"]))
    controller.require_limits_of(display)
    return controller


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
        FeedForward.from_document(entry["feed_forward"]) if "feed_forward" in entry else None,
    )

"""The file controller.json: a designed controller with the display it was designed for."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tactuator.errors import BadInput, within
from tactuator.io.atomic import write_text
from tactuator.io.display import parse_display
from tactuator.io.kinds import read_document
from tactuator.model.controller import FORMAT, ChannelController, Controller
from tactuator.model.description import document_hash
from tactuator.parameters import from_table


def write_controller(path: str | Path, controller: Controller) -> None:
    """Write controller.json, whole or not at all."""
    write_text(path, controller_text(controller), "controller")


def controller_text(controller: Controller) -> str:
    """Return the text of controller.json."""
    return json.dumps(controller.document(), indent=1) + "\n"


def read_controller(path: str | Path) -> Controller:
    """Read controller.json; BadInput, one line, if it is not one, or was changed by hand."""
    path = Path(path)
    document = read_document(path, "controller", FORMAT)
    with within(f"controller {path}"):
        try:
            return parse_controller(document)
        except BadInput:
            raise
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise BadInput(f"{error!r} is amiss", "a file that `design` wrote") from None


def parse_controller(document: dict[str, Any]) -> Controller:
    """Return the controller of a document. Raises BadInput for a hash that does not fit."""
    if document.get("hash") != document_hash(document):
        raise BadInput("its hash does not fit its contents", "a file as `design` wrote it")
    display = parse_display(document["display"])
    channels = tuple(from_table(ChannelController, entry, "channel") for entry in document["channels"])
    controller = Controller(display, channels, str(document["tool"]))
    controller.require_limits_of(display)
    return controller

"""The file controller.json: a designed controller with the display it was designed for."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tactuator.errors import BadInput
from tactuator.io.atomic import write_text
from tactuator.io.display import parse_display
from tactuator.io.kinds import require_kind
from tactuator.io.text import read_json
from tactuator.model.controller import FORMAT, ChannelController, Controller
from tactuator.model.description import document_hash
from tactuator.parameters import from_table


def write_controller(path: str | Path, controller: Controller) -> None:
    """Write controller.json, whole or not at all."""
    write_text(path, controller_text(controller))


def controller_text(controller: Controller) -> str:
    """Return the text of controller.json."""
    return json.dumps(controller.document(), indent=1) + "\n"


def read_controller(path: str | Path) -> Controller:
    """Read controller.json; BadInput, one line, if it is not one, or was changed by hand."""
    path = Path(path)
    require_kind(path, "controller")
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
    channels = tuple(from_table(ChannelController, entry, "channel") for entry in document["channels"])
    controller = Controller(display, channels, str(document["tool"]))
    controller.require_limits_of(display)
    return controller

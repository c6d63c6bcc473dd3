"""Controller files for the verbs: the paper's, and spoilt ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from tactuator.files.controller import read_controller, write_controller
from tests.digital.paper_display import channel, controller, display


def paper_file(folder: Path) -> str:
    """The paper's controller of one finger."""
    path = folder / "controller.json"
    write_controller(path, controller(display(channel())))
    return str(path)


def spoilt(path: str, **fields: object) -> str:
    """The same, its channel changed."""
    read = read_controller(path)
    write_controller(path, replace(read, channels=(replace(read.channels[0], **fields),)))  # type: ignore[arg-type]
    return path


def unstable(path: str) -> str:
    """The same, its loop closing no more."""
    sections = np.array(read_controller(path).channels[0].feedback_sos)
    sections[0, :3] *= 60.0
    return spoilt(path, feedback_sos=sections)

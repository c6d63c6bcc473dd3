"""Controller files for the verbs: the paper's, and spoilt ones."""

from pathlib import Path

import pytest

from tactuator.io.controller import read_controller, write_controller
from tests.runtime.paper_display import changed, channel, controller, display, louder


@pytest.fixture
def made(tmp_path: Path) -> str:
    """The paper's controller of one finger."""
    path = tmp_path / "controller.json"
    write_controller(path, controller(display(channel())))
    return str(path)


def spoilt(path: str, **fields: object) -> str:
    """The same, its channel changed."""
    write_controller(path, changed(read_controller(path), **fields))
    return path


def unstable(path: str) -> str:
    """The same, its loop closing no more."""
    write_controller(path, louder(read_controller(path), 60.0))
    return path

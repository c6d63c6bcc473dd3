"""The program in this process."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tactuator.cli import main
from tests.cli.refusals import refused


class Ended(NamedTuple):
    status: int
    out: str
    err: str


class Program:
    """Runs commands; a word may be a path."""

    def __init__(self, capture: pytest.CaptureFixture[str], folder: Path) -> None:
        self._capture, self._folder = capture, folder

    def __call__(self, *words: object) -> Ended:
        self._capture.readouterr()
        status = main([str(word) for word in words])
        return Ended(status, *self._capture.readouterr())

    def json(self, *words: object, status: int = 0) -> Any:
        """The one object that the command prints with `--json`."""
        ended = self(*words, "--json")
        assert (ended.status, ended.out.count("\n")) == (status, 1), ended
        return json.loads(ended.out)

    def refused(self, *words: object, said: str, status: int = 2) -> None:
        """One line, that status, nothing new in the test's folder."""
        self._capture.readouterr()
        refused([str(word) for word in words], said, self._capture, self._folder, status)


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Program:
    return Program(capfd, tmp_path)

"""The program in this process, and a desk with files to give it."""

import json
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from tactuator.cli import main
from tactuator.io.controller import write_controller
from tactuator.io.record import write_record
from tactuator.io.reference import ReferenceHead, write_reference
from tactuator.signals.record import Record
from tactuator.speech.reading import sample_path
from tests.cli.refusals import refused
from tests.experiment.session.apparatuses import PROTOCOL
from tests.experiment.session.recognising import protocol_text
from tests.one_finger import DISPLAY
from tests.runtime.paper_display import channel, controller, display


class Ended(NamedTuple):
    """How a command ended, and what it said."""

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

    def refused(self, *words: object, said: str) -> None:
        """One line, status 2, nothing new in the test's folder."""
        self._capture.readouterr()
        refused([str(word) for word in words], said, self._capture, self._folder)


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Program:
    return Program(capfd, tmp_path)


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a file of each kind: a display of one finger, the paper's controller of it, protocols, data."""
    folder = tmp_path_factory.mktemp("files")
    (folder / "display.toml").write_text(DISPLAY)
    write_controller(folder / "controller.json", controller(display(channel())))
    (folder / "protocol.toml").write_text(PROTOCOL)
    (folder / "words.toml").write_text(protocol_text())
    write_record(folder / "record.h5", Record(1000.0, *np.random.default_rng(0).standard_normal((2, 500))))
    with write_reference(folder / "r.wav", ReferenceHead(4000.0, ("index",))) as writer:
        writer.write(np.zeros((400, 1)))
    shutil.copy(sample_path(), folder / "speech.wav")
    return folder


@pytest.fixture
def desk(files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The test's folder with those files, in which commands are given."""
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path

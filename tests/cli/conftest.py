"""A desk with files to give the program."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tactuator.io.controller import write_controller
from tactuator.io.record import write_record
from tactuator.io.reference import ReferenceHead, write_reference
from tactuator.signals.record import Record
from tactuator.speech.reading import sample_path
from tests.experiment.session.apparatuses import PROTOCOL
from tests.experiment.session.recognising import protocol_text
from tests.one_finger import DISPLAY
from tests.runtime.paper_display import channel, controller, display


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

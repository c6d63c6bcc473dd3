"""Every reader of a file, with a whole file for it, the call that reads it, and a command that does."""

from __future__ import annotations

import asyncio
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import scipy.io
import soundfile

import tactuator
from tactuator.experiment.protocol.file import read_protocol
from tactuator.experiment.protocol.study import StudyProtocol
from tactuator.experiment.words import read_words
from tactuator.io.controller import read_controller
from tactuator.io.csv_tables import read_curve, read_matrix, read_pairs, read_relative_curve
from tactuator.io.display import read_display, read_environment
from tactuator.io.model import read_model
from tactuator.io.record import read_foreign_response, read_record, write_record
from tactuator.io.reference import ReferenceHead, content_sha256, write_reference
from tactuator.io.response import read_responses
from tactuator.io.text import read_content
from tactuator.rig.boards import read_boards
from tactuator.runtime.image import read_image_header
from tactuator.signals.record import Record
from tactuator.speech.coding import read_coding
from tactuator.speech.reading import scan_speech
from tactuator.verbs.experiment import thresholds
from tactuator.web.serve import _operator_token
from tactuator.web.server import Address

EXAMPLES = Path(tactuator.__file__).parent / "io/examples"
_LANGUAGE = Path(tactuator.__file__).parent / "experiment/language/de.toml"
_BOARDS = Path(__file__).parents[2] / "firmware/stm32f405/board.toml"
_SPEECH = ("wav", "flac", "aiff", "ogg", "mp3", "au", "w64", "rf64", "caf")


@dataclass(frozen=True)
class Reader:
    """A reader: the file's name, the call that reads a file, and a command whose {} stands for the file."""

    file: str
    read: Callable[[Path], object]
    command: str = ""

    @property
    def name(self) -> str:
        """The file and the function that reads it."""
        return f"{self.file} ({self.read.__name__.strip('_')})"


def _protocol(path: Path) -> object:
    return read_protocol(path, StudyProtocol)


def _boards(path: Path) -> object:
    return read_boards(path.parent.parent)


def _scale(path: Path) -> object:
    return content_sha256(path.with_suffix(".wav"))


def _record(path: Path) -> object:
    return read_record(path, rate_hz=2000.0)


def _image(path: Path) -> object:
    return read_image_header(read_content(path))


def _environment(path: Path) -> object:
    return read_environment(path, "index")


def _words(path: Path) -> object:
    return read_words(path, "de")


def _certificate(path: Path) -> object:
    return Address(certificate=path)


READERS = (
    Reader("bench.csv", _record, "identify {} --input drive --output encoder --time t --out o.json"),
    Reader("record.h5", _record, "identify {} --out o.json"),
    Reader("record.mat", _record, "identify {} --out o.json"),
    Reader("record.wav", read_record, "identify {} --out o.json"),
    Reader("record.flac", read_record),
    Reader("reference.wav", content_sha256, "play {} --controller controller.json"),
    Reader("reference.json", _scale, "play bad/reference.wav --controller controller.json"),
    Reader("reference.h5", content_sha256, "play {} --controller controller.json"),
    Reader("curve.csv", read_curve, "experiment thresholds --store lab.db --reference {}"),
    Reader("loss.csv", read_relative_curve, "experiment simulate --procedure curve --runs 2 --trials 5 --truth {}"),
    Reader("confusion.csv", read_matrix, "experiment information --matrix {}"),
    Reader("pairs.csv", read_pairs, "calibrate {}"),
    Reader("model.json", read_model),
    Reader("responses.h5", read_responses),
    Reader("sheet.csv", read_foreign_response, "identify {} --out o.json"),
    Reader("display.toml", read_display, "record {} --out o.h5 --duration-s 1"),
    Reader("controller.json", read_controller, "build {} --out o.tim"),
    Reader("image.tim", _image, "image {}"),
    Reader("board.toml", _boards),
    Reader("de.toml", _words),
    Reader("protocol.toml", _protocol, "experiment observe {} --store o.db --controller controller.json"),
    Reader("recognition.toml", _protocol),
    Reader("lab.db", thresholds, "experiment thresholds --store {}"),
    Reader("coding.toml", read_coding, "render speech.wav --controller controller.json --coding {} --out s.wav"),
    Reader("environment.json", _environment),
    Reader("token.txt", _operator_token),
    Reader("pair.pem", _certificate),
    *(
        Reader(f"speech.{kind}", scan_speech, "render {} --controller controller.json --out s.wav" * (kind != "rf64"))
        for kind in _SPEECH
    ),
)


def make_files(folder: Path, display: Path, short: str) -> None:
    """Make a whole file for every reader in the folder. short: a protocol that ends soon."""
    os.chdir(folder)
    for name in ("bench.csv", "curve.csv", "loss.csv", "confusion.csv", "pairs.csv", "sheet.csv", "coding.toml"):
        (folder / name).write_bytes((EXAMPLES / name).read_bytes())
    coding = (folder / "coding.toml").read_text(encoding="utf-8")
    (folder / "coding.toml").write_text(re.sub("fingers = .*", 'fingers = ["index"]', coding), encoding="utf-8")
    (folder / "protocol.toml").write_text(short, encoding="utf-8")
    (folder / "recognition.toml").write_bytes((EXAMPLES / "protocols/recognition.toml").read_bytes())
    (folder / "display.toml").write_bytes(display.read_bytes())
    (folder / "de.toml").write_bytes(_LANGUAGE.read_bytes())
    (folder / "board.toml").write_bytes(_BOARDS.read_bytes())
    (folder / "token.txt").write_text("a-token-of-more-than-sixteen\n", encoding="ascii")
    rng = np.random.default_rng(1)
    u, y = rng.standard_normal((2, 4000)) * 0.1
    write_record(folder / "record.h5", Record(2000.0, u, y, "V", "V"))
    scipy.io.savemat(folder / "record.mat", {"u": u, "y": y, "fs": 2000.0}, do_compression=True)
    for kind in ("wav", "flac"):
        soundfile.write(folder / f"record.{kind}", np.stack([u, y], axis=1), 8000)
    for kind in _SPEECH:
        soundfile.write(folder / f"speech.{kind}", u, 16000)
    for kind in ("wav", "h5"):
        with write_reference(folder / f"reference.{kind}", ReferenceHead(4000.0, ("index",))) as writer:
            writer.write(u[:, None])
    _by_the_program(folder)
    found = {"hum_hz": [50.0, 100.0], "hum_v_peak": [1.5e-3, 0.25e-3], "noise_v_rms": 0.31e-3}
    document = {"format": "tactuator-environment/1", "tool": "1", "channels": {"index": found}}
    (folder / "environment.json").write_text(json.dumps(document, indent=1), encoding="utf-8")


def _by_the_program(folder: Path) -> None:
    """Make what only the program writes."""
    for line in (
        "design display.toml --out controller.json",
        "build controller.json --out image.tim",
        "identify bench.csv --input drive --output encoder --time t --out model.json",
        "measure --controller controller.json --frequency-hz 30,100 --longest-s 1 --out responses.h5",
        "experiment observe protocol.toml --store lab.db --controller controller.json",
    ):
        subprocess.run([sys.executable, "-m", "tactuator", *line.split()], check=False, stdout=subprocess.DEVNULL)
    own = "req -x509 -newkey rsa:2048 -nodes -days 9 -subj /CN=localhost -keyout key.pem -out pair.pem"
    subprocess.run(["openssl", *own.split()], check=True, capture_output=True)
    with (folder / "pair.pem").open("ab") as pair:
        pair.write((folder / "key.pem").read_bytes())


def warm() -> None:
    """Import what the readers and the commands use, so that a fork need not."""
    import tactuator.cli.main  # noqa: F401, PLC0415

    asyncio.run(asyncio.sleep(0))
    h5py.get_config()

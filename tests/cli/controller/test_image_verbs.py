"""`tactuator build` and `image`, as a user runs them."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactuator.cli import main
from tactuator.io.controller import read_controller, write_controller
from tactuator.model.controller import Limits
from tactuator.runtime.image import sealed
from tests.cli.controller.controller_files import made, spoilt, unstable  # noqa: F401
from tests.cli.refusals import refused
from tests.runtime.paper_display import channel, controller, display


@pytest.mark.parametrize("number_format", ["float32", "q31"])
def test_build__then_image__say_the_same_of_it(
    number_format: str, made: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "image.bin"
    assert main(["build", made, "--format", number_format, "--out", str(out), "--json"]) == 0
    built = json.loads(capsys.readouterr().out)
    assert built["image"] == str(out)
    assert built["bytes"] == out.stat().st_size
    assert (built["format"], built["rate_hz"], built["channels"]) == (number_format, 4000.0, 1)
    assert built["controller"] == read_controller(made).content_hash
    assert 0.0 <= built["response_error_db"] < 1e-3
    assert main(["image", str(out), "--controller", made, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found.pop("is_of_controller") is True
    assert found["delay_samples"] == 1
    assert found == {key: value for key, value in built.items() if key != "response_error_db"}
    assert main(["image", str(out)]) == 0
    assert found["crc32"] in capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["controller.json", "image.bin"]


def test_build__again__is_the_same_bytes_and_replaces(
    made: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "image.bin"
    out.write_bytes(b"old")
    contents = []
    for _ in range(2):
        assert main(["build", made, "--out", str(out)]) == 0
        contents.append(out.read_bytes())
    assert contents[0] == contents[1] != b"old"
    assert "float32" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--out", "FOLDER/i.bin", "--format", "q15"], "format is 'q15'; allowed: float32, q31"),
        (["--out", "FOLDER/i.bin", "--format", "q31 biquads"], "format is 'q31 biquads'; allowed: float32, q31"),
        (["--out", "FOLDER/none/i.bin"], "none is not a folder"),
        ([], "--out"),
    ],
)
def test_build__misused__is_refused(
    options: list[str], words: str, made: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(["build", made, *options], words, capsys, tmp_path)


def test_build__unsafe_or_beyond_the_format__is_refused_and_an_older_image_stays(
    made: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "image.bin"
    out.write_bytes(b"old")
    words = "format float32 is not safe for this controller (unstable); allowed: what `wordlength` calls safe"
    refused(["build", unstable(made), "--out", str(out)], words, capsys, tmp_path)
    spoilt(made, limits=Limits(20.0, 2.0))
    words = "limits: command_v is 20; allowed: above 0, at most 10 V, the converter's range"
    refused(["build", made, "--format", "q31", "--out", str(out)], words, capsys, tmp_path)
    assert out.read_bytes() == b"old"


@pytest.fixture
def image(made: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    out = tmp_path / "image.bin"
    assert main(["build", made, "--out", str(out), "--json"]) == 0
    capsys.readouterr()
    return out


def resealed(content: bytes, at: int, field: bytes) -> bytes:
    return sealed(content[:at] + field + content[at + len(field) : -4])


BAD_IMAGES = {
    "empty": (lambda image: b"", "it is truncated"),
    "one byte short": (lambda image: image[:-1], "it is truncated, or longer than it says"),
    "half": (lambda image: image[: len(image) // 2], "it is truncated"),
    "one byte long": (lambda image: image + b"\0", "it is truncated, or longer than it says"),
    "one bit flipped": (lambda image: image[:90] + bytes([image[90] ^ 4]) + image[91:], "its checksum does not fit"),
    "not an image": (lambda image: b"PNG!" + image[4:], "it is no image; allowed: a file that `build` wrote"),
    "future version": (lambda image: resealed(image, 4, struct.pack("<H", 99)), "its version is not known here"),
    "another format": (lambda image: resealed(image, 6, struct.pack("<H", 9)), "its number format is not known"),
    "not a number": (
        lambda image: resealed(image, len(image) - 24, struct.pack("<f", np.nan)),
        "a coefficient is not a number",
    ),
}


@pytest.mark.parametrize(("spoil", "words"), BAD_IMAGES.values(), ids=BAD_IMAGES)
def test_image__bad__is_refused(
    spoil: object, words: str, image: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert callable(spoil)
    image.write_bytes(spoil(image.read_bytes()))
    refused(["image", str(image)], words, capsys, tmp_path)


def test_image__that_is_not_there__is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = "No such file or directory; allowed: one that can be read"
    refused(["image", str(tmp_path / "none.bin")], words, capsys, tmp_path)
    refused(["image", str(tmp_path)], "Is a directory", capsys, tmp_path)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rate_hz": 8000.0}, "it is for another rate than the board runs at"),
        ({"delay_samples": 2}, "it is for another computing delay"),
        ({"channels": tuple(display().channels)}, "it is for another number of channels"),
    ],
)
def test_image__for_another_display__is_refused(
    changes: dict[str, object], words: str, image: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.json"
    write_controller(other, controller(replace(display(channel()), **changes)))  # type: ignore[arg-type]
    refused(["image", str(image), "--controller", str(other)], words, capsys, tmp_path)


def test_image__of_another_controller__status_1(made: str, image: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spoilt(made, limits=Limits(9.0, 2.0))
    assert main(["image", str(image), "--controller", made, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["is_of_controller"] is False

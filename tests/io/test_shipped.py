"""The examples as they are shipped: whole, small, and read by the readers they are meant for."""

from pathlib import Path

import pytest

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import read_any_protocol
from tactuator.io.csv_tables import read_curve, read_matrix, read_pairs, read_relative_curve
from tactuator.io.display import read_display
from tactuator.io.record import is_response, read_foreign_response, read_record
from tactuator.io.reference import open_reference
from tactuator.io.shipped import EXAMPLES, copy_examples, example_names
from tactuator.speech.coding import coding_of, read_coding
from tactuator.speech.reading import scan_speech

PAGE = (EXAMPLES / "README.md").read_text(encoding="utf-8")
NAMES = [name for name in example_names() if name != "README.md"]


def test_examples__all__are_below_one_and_a_half_megabytes_and_stand_in_the_page():
    assert sum((EXAMPLES / name).stat().st_size for name in example_names()) < 1_500_000
    beside = {name: name[:-5] + ".wav" for name in NAMES if name.startswith("protocols/") and name.endswith(".json")}
    assert [name for name in NAMES if f"`{beside.get(name, name)}`" not in PAGE] == []


READERS = {
    "*.csv": lambda path: path.stat(),
    "display.toml": read_display,
    "displays/*.toml": read_display,
    "protocol.toml": read_any_protocol,
    "protocols/*.toml": read_any_protocol,
    "protocols/*.wav": open_reference,
    "bench.csv": lambda path: read_record(path, input_name="drive", output_name="encoder", time_name="t"),
    "sheet.csv": read_foreign_response,
    "pairs.csv": read_pairs,
    "curve.csv": read_curve,
    "loss.csv": read_relative_curve,
    "confusion.csv": read_matrix,
    "coding.toml": read_coding,
    "speech.wav": scan_speech,
    "recordings/*": scan_speech,
}


@pytest.mark.parametrize("name", [n for n in NAMES if n != "bench.toml" and not n.endswith(".json")])
def test_examples__each__is_read_by_its_reader(name):
    fitting = [read for pattern, read in READERS.items() if Path(name).match(pattern)]
    assert fitting
    for read in fitting:
        read(EXAMPLES / name)


def test_examples__each__is_what_the_others_take_it_for():
    with pytest.raises(BadInput, match=r"model\.json"):  # it is identified first
        read_display(EXAMPLES / "bench.toml")
    assert is_response(EXAMPLES / "sheet.csv")
    assert not is_response(EXAMPLES / "bench.csv")
    display = read_display(EXAMPLES / "display.toml")
    head = open_reference(EXAMPLES / "protocols" / "a.wav").head
    assert (head.rate_hz, head.channels) == (display.rate_hz, tuple(channel.name for channel in display.channels))
    assert read_coding(EXAMPLES / "coding.toml") == coding_of("envelope")


def test_copy__into_a_new_folder_twice__has_every_byte_and_changes_nothing(tmp_path):
    folder = tmp_path / "new" / "deep"
    written = copy_examples(folder)
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert [path.relative_to(folder).as_posix() for path in written] == list(example_names())
    assert [path.read_bytes() for path in written] == [(EXAMPLES / name).read_bytes() for name in example_names()]
    copy_examples(folder)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before


def test_copy__where_something_else_lies__nothing_is_written(tmp_path):
    (tmp_path / "speech.wav").write_text("my own", encoding="ascii")
    with pytest.raises(BadInput, match=r"speech\.wav is there already"):
        copy_examples(tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == ["speech.wav"]


def test_copy__that_fails_midway__takes_back_what_it_wrote(tmp_path, monkeypatch):
    copied = []

    def full(target, content):
        if len(copied) == 5:
            raise OSError(28, "No space left on device")
        copied.append(target)
        return real(target, content)

    real = Path.write_bytes
    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(BadInput, match="No space left"):
        copy_examples(tmp_path / "new")
    assert list(tmp_path.iterdir()) == []

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


def test_examples__all__are_below_one_and_a_half_megabytes():
    assert sum((EXAMPLES / name).stat().st_size for name in example_names()) < 1_500_000


@pytest.mark.parametrize("name", NAMES)
def test_examples__each__stands_in_the_page(name):
    whole = name if not name.startswith("protocols/") or not name.endswith(".json") else name[:-5] + ".wav"
    assert f"`{whole}`" in PAGE


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


def test_bench_display__before_identification__names_the_model_that_is_missing():
    with pytest.raises(BadInput, match=r"model\.json"):
        read_display(EXAMPLES / "bench.toml")


def test_examples__response_and_record__are_told_apart():
    assert is_response(EXAMPLES / "sheet.csv")
    assert not is_response(EXAMPLES / "bench.csv")


def test_examples__references__are_those_of_the_display():
    display = read_display(EXAMPLES / "display.toml")
    head = open_reference(EXAMPLES / "protocols" / "a.wav").head
    assert head.rate_hz == display.rate_hz
    assert head.channels == tuple(one.name for one in display.channels)


def test_examples__coding__is_the_one_it_was_written_from():
    assert read_coding(EXAMPLES / "coding.toml") == coding_of("envelope")


def test_copy__into_a_new_folder__has_every_byte(tmp_path):
    written = copy_examples(tmp_path / "new" / "deep")
    assert [path.relative_to(tmp_path / "new" / "deep").as_posix() for path in written] == list(example_names())
    assert all(
        path.read_bytes() == (EXAMPLES / n).read_bytes() for path, n in zip(written, example_names(), strict=True)
    )


def test_copy__twice__changes_nothing(tmp_path):
    copy_examples(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    copy_examples(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


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

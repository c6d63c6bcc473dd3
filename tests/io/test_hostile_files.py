"""Files refused in one line: not what a reader reads, cut off, changed by a byte, claiming more than they hold."""

import json
import os
import re
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
import soundfile

from firmware.build import read_boards
from tactuator.errors import BadInput
from tactuator.experiment.protocol.codes import taken_for
from tactuator.experiment.words import read_words
from tactuator.io import columns, hdf5, text_table
from tactuator.io.cells import cell_pair, cell_value
from tactuator.io.column_name import column_name
from tactuator.io.controller import read_controller
from tactuator.io.csv_tables import read_contours, read_curve, read_matrix, read_pairs
from tactuator.io.display import parse_display
from tactuator.io.model import read_model, write_model
from tactuator.io.record import read_record, write_record
from tactuator.io.reference import ReferenceHead, open_reference, write_reference
from tactuator.io.response import read_responses
from tactuator.io.shipped import EXAMPLES
from tactuator.io.text import parse_toml, read_content
from tactuator.model.plant_model import PlantModel
from tactuator.signals.record import Record
from tactuator.speech.coding import read_coding
from tactuator.speech.reading import scan_speech
from tactuator.web.server import Address

CONTOURS = b"level_db_sl,frequency_hz,db_sl\n"
CURVE = b"frequency_hz,level_db_re_1um\n"
TWO = CONTOURS + b"10,30,9\n10,100,10\n"
record = partial(read_record, rate_hz=10.0)


@pytest.mark.parametrize(
    ("read", "name", "content", "words"),
    [
        (read_controller, "c.json", None, "file not found"),
        (read_controller, "c.json", b"{", "it is not JSON"),
        (read_controller, "c.json", b"\xff\xfe\x00", "it is not text"),
        (read_controller, "c.json", b"{}", "format is None; it must be 'tactuator-controller/1'"),
        (read_controller, "c.json", b"[]", "format is None"),
        (read_controller, "c.json", b'{"format": "tactuator-controller/2"}', "is 'tactuator-controller/2'; it must"),
        (read_model, "m.json", b"", "it is not JSON"),
        (read_model, "m.json", b"[]", "; "),
        (read_model, "m.json", b'{"format": "other"}', "; "),
        (read_model, "m.json", b'{"format": "tactuator-model/1"}', "; "),
        (read_responses, "r.h5", b"no", "; "),
        (read_pairs, "p.csv", b"", "no column displacement_mm, voltage_v"),
        (
            read_pairs,
            "p.csv",
            b"displacement_mm,volts\n1,2\n",
            "no column voltage_v .2 columns, 1 rows.; expected displacement_mm",
        ),
        (read_pairs, "p.csv", b"displacement_mm,voltage_v\n1,x\n", "voltage_v is 'x' in row 2"),
        (read_pairs, "p.csv", b"displacement_mm,voltage_v\n1,2\n1,nan\n", "row 3 has 1 mm and nan V; expected finite"),
        (read_contours, "c.csv", b"", "0 columns, 0 rows.; expected level_db_sl, frequency_hz, db_sl"),
        (read_contours, "c.csv", CONTOURS + b"10,30,x\n", "db_sl is 'x' in row 2"),
        (read_contours, "c.csv", TWO + b"20,100,20\n", "3 rows for 2 contours and 2 freq"),
        (read_contours, "c.csv", b"# name: a\n# reference_hz: x\n" + TWO, "reference_hz is x; "),
        (read_contours, "c.csv", b"# name: a\n# area_mm2: x\n" + TWO, "area_mm2 is 'x'"),
        (read_contours, "c.csv", b"# name: a\n# age_years: 20\n" + TWO, "age_years"),
        (read_contours, "c.csv", b"# name: a\n# provenance: b\n" + TWO, "provenance is 'b'"),
        (read_curve, "c.csv", None, "file not found"),
        (read_curve, "c.csv", b"\xff\xfe\x00", "not text"),
        (read_curve, "c.csv", b"", "0 columns, 0 rows.; expected frequency_hz"),
        (read_curve, "c.csv", b"hz,db\n1,2\n", "2 columns, 1 rows.; expected frequency_hz, level_db_re_1um or acceler"),
        (read_curve, "c.csv", CURVE + b"1,x\n", "level_db_re_1um is 'x' in row 2; expected a number"),
        (read_curve, "c.csv", CURVE + b"1,2\n2\n", "; "),
        (read_curve, "c.csv", b"frequency_hz,acceleration_m_s2_rms\n1,2\n2,-3\n3,1\n", "not a finite number"),
        (read_matrix, "m.csv", None, "file not found"),
        (read_matrix, "m.csv", b"", "no rows"),
        (read_matrix, "m.csv", b"1,2\n3\n", "equal length"),
        (read_matrix, "m.csv", b"a,b\n", "equal length"),
        (read_matrix, "m.csv", b"1,2\n3,x\n", "not a number"),
        (record, "none.csv", None, "file not found"),
        (record, "r.csv", b"", "empty"),
        (record, "r.csv", b"t,u,y\n", "no rows"),
        (record, "r.csv", b"t,u,y\n1,2,3\n2,3\n", "row 2 has 2 of 3 columns; expected as many in each"),
        (record, "r.csv", b"t,u,y\n1,2,3\nthe end\n4,5,6\n", "row 2 has 1 of 3 columns; expected '#' before lines"),
        (record, "r.csv", b"t,u,y\n1,2,3\na,b,c\n4,5,6\n", "u is not a number in row 2 of 3"),
        (record, "r.mat", b"not a mat file at all", "cut short or spoilt .*; expected a whole file"),
        (record, "r.h5", b"not hdf5", "record"),
        (record, "r.wav", b"RIFFnothing", "record"),
        (record, "r.png", b"", ".csv"),
    ],
)
def test_reader__file_that_it_does_not_read__is_refused_in_one_line(tmp_path, read, name, content, words) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(BadInput, match=words) as refusal:
        read(tmp_path / name)
    assert "\n" not in str(refusal.value)


RNG = np.random.default_rng(0)
U, Y = RNG.standard_normal((2, 4000)) * 0.1
MODEL = PlantModel(np.array([2875.0]), np.array([1.0, 94.0, 290.0]), 0.0, np.diag([9.0, 0.01, 0.09, 0.0]), (0.4, 300.0))


def one_line(call: Callable[[], object], words: str) -> None:
    with pytest.raises(BadInput, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
    assert "; " in str(caught.value)


def test_tables__longer_than_is_measured_or_with_thousands__refused(tmp_path: Path) -> None:
    path = tmp_path / "long.csv"
    path.write_text("a,b\n" + "1,2\n" * 100_000)
    for read in (read_curve, read_matrix, read_pairs):
        one_line(lambda read=read: read(path), r"10000\d lines; expected up to 100000")
    path.write_text("1," * 2_000_000)
    one_line(lambda: read_record(path), "a line is longer")
    (tmp_path / "c.csv").write_text('frequency_hz,level_db_re_1um\n"1,000","1,250"\n"2,000","1,500"\n')
    one_line(lambda: read_curve(tmp_path / "c.csv"), "thousands")
    (tmp_path / "r.csv").write_text('u,y\n"1,000","1,250"\n"2,000","1,500"\n')
    one_line(lambda: read_record(tmp_path / "r.csv", rate_hz=10.0), "thousands")


def claiming(path: Path, shape: tuple[int, ...], names: str) -> Path:
    with h5py.File(path, "w") as file:
        for name in ("command", "position", *names):
            file.create_dataset(name, shape=shape, dtype="f4", chunks=True, compression="gzip")
    assert path.stat().st_size < 100_000
    return path


def test_hdf5__claims_more_than_may_be_held__refused_or_read_in_part(tmp_path: Path, monkeypatch) -> None:
    for shape in ((600_000_000, 2), (1_200_000_000,)):
        path = claiming(tmp_path / "claim.h5", shape, "abcdefgh")
        one_line(lambda path=path: read_record(path, rate_hz=4000.0), "claims to hold")
    monkeypatch.setattr(columns, "MOST_SAMPLES", 1000)
    row = claiming(tmp_path / "row.h5", (1, 1_200_000_000), "")
    assert read_record(row, rate_hz=4000.0).command.size == 1000


def test_hdf5__damaged_so_that_the_library_ends_or_never_ends__refused(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "r.h5"
    write_record(path, Record(1000.0, U, Y, "V", "V"))
    monkeypatch.setattr(hdf5, "_look", lambda _: os.abort())
    one_line(lambda: read_record(path), "breaks down")
    monkeypatch.setattr(hdf5, "_CPU_S", 0)
    monkeypatch.setattr(hdf5, "_look", lambda _: [None for _ in iter(int, 1)])
    one_line(lambda: read_responses(path), "breaks down")


def test_matlab__claims_or_holds_more_or_crashes__refused(tmp_path, monkeypatch) -> None:
    path = tmp_path / "r.mat"
    scipy.io.savemat(path, {"u": U, "y": Y, "fs": 1000.0}, do_compression=True)
    assert read_record(path).rate_hz == 1000.0
    with monkeypatch.context() as patch:
        patch.setattr(columns, "MOST_VALUES", 3000)
        one_line(lambda: read_record(path), "claims to hold 8001 numbers")
    with monkeypatch.context() as patch:
        patch.setattr(scipy.io, "loadmat", lambda *_, **__: os.abort())
        one_line(lambda: read_record(path), "breaks down")
    cells = np.empty(1, dtype=object)
    cells[0] = np.zeros(9_000_000)  # over 32 MB: memory that the allocator has to ask for
    scipy.io.savemat(path, {"u": U, "y": Y, "c": cells}, do_compression=True)
    monkeypatch.setattr(hdf5, "_MEMORY_BYTES", 40 << 20)
    one_line(lambda: read_record(path), "more than 40 MB of memory")


@pytest.mark.parametrize("ending", [".w64", ".rf64", ".au", ".caf", ".ogg", ".mp3", ".wav", ".flac", ".aiff"])
def test_sound__cut__refused_by_every_reader_whatever_its_format(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"r{ending}"
    soundfile.write(path, np.stack([U, Y], axis=1), 16000)
    assert scan_speech(path).frames == U.size
    content = bytearray(path.read_bytes())
    for share in (0.999, 0.5):
        path.write_bytes(content[: int(share * len(content))])
        one_line(lambda: scan_speech(path), "truncated|not readable|frames")
    if ending in (".wav", ".flac"):
        one_line(lambda: read_record(path), "truncated|.")
    if ending == ".wav":
        content[4:8] = (6000 - 8).to_bytes(4, "little")  # as a repair program does, the chunk's own length left alone
        path.write_bytes(content[:6000])
        one_line(lambda: scan_speech(path), "truncated")
        one_line(lambda: read_record(path), "truncated")


def test_reference_cut_or_coding_at_a_rate_that_is_none__refused(tmp_path: Path) -> None:
    for name in ("r.wav", "r.h5"):
        with write_reference(tmp_path / name, ReferenceHead(4000.0, ("index",))) as writer:
            writer.write(U[:, None])
    wav = tmp_path / "r.wav"
    wav.write_bytes(wav.read_bytes()[: wav.stat().st_size // 2])
    with h5py.File(tmp_path / "r.h5", "r+") as file:
        file["reference"].resize(1_000_000_000, axis=0)
    one_line(lambda: open_reference(wav), "truncated")
    one_line(lambda: open_reference(tmp_path / "r.h5"), "fewer samples")
    text = (EXAMPLES / "coding.toml").read_text(encoding="utf-8")
    (tmp_path / "coding.toml").write_text(text.replace("analysis_hz = 16000.0", "analysis_hz = nan"), encoding="utf-8")
    one_line(lambda: read_coding(tmp_path / "coding.toml"), "analysis_hz is")


@pytest.mark.parametrize(
    "change", ['"provenance": 5', '"channels": 3', '"curves": [1]', '"rate_hz": NaN', '"band_hz": [1]']
)
def test_reference__scale_file_amiss__refused(tmp_path: Path, change: str) -> None:
    with write_reference(tmp_path / "r.wav", ReferenceHead(4000.0, ("index",), band_hz=(1.0, 2.0))) as writer:
        writer.write(U[:, None])
    beside = tmp_path / "r.json"
    document = json.loads(beside.read_text()) | json.loads(f"{{{change}}}")
    beside.write_text(json.dumps(document))
    one_line(lambda: open_reference(tmp_path / "r.wav"), "; ")


@pytest.mark.parametrize(
    ("encoding", "style"),
    [
        ("utf-8", "plain"),
        ("utf-8-sig", "quoted"),
        ("utf-16", "decimal commas"),
        ("utf-16-le", "quoted decimal commas"),
        ("utf-16-be", "plain"),
    ],
)
def test_tables__as_spreadsheets_write_them__same_numbers(tmp_path: Path, encoding: str, style: str) -> None:
    mark = '"' if "quoted" in style else ""
    delimiter = ";" if style == "decimal commas" else ","

    def table(name: str, header: list[str], rows: list[list[float]]) -> Path:
        lines = [delimiter.join(f"{mark}{cell}{mark}" for cell in header)]
        for row in rows:
            cells = [f"{cell:.4f}".replace(".", "," if "commas" in style else ".") for cell in row]
            lines.append(delimiter.join(f"{mark}{cell}{mark}" for cell in cells))
        (tmp_path / name).write_bytes("\r\n".join(lines).encode(encoding))
        return tmp_path / name

    rows = [[k / 1000.0, float(U[k]), float(Y[k])] for k in range(50)]
    record = read_record(table("r.csv", ["time_s", "command_v", "position_v"], rows))
    np.testing.assert_allclose(record.position, Y[:50], atol=1e-4)
    curve = read_curve(
        table("c.csv", ["frequency_hz", "level_db_re_1um"], [[1.5, 20.25], [10.5, 3.125], [250.0, -20.5]])
    )
    np.testing.assert_array_equal(curve.level_db_re_1um, [20.25, 3.125, -20.5])
    pairs = read_pairs(table("p.csv", ["displacement_mm", "voltage_v"], [[0.5, 1.5], [1.0, 2.5]]))
    np.testing.assert_array_equal(pairs.voltage_v, [1.5, 2.5])
    matrix = read_matrix(table("m.csv", ["pa", "ba"], [[5.0, 1.0], [2.0, 6.0]]))
    np.testing.assert_array_equal(matrix.counts, [[5, 1], [2, 6]])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ('"delay_s": NaN', "NaN"), ('"delay_s": 1e999', "1e999"), ('"delay_s": -1.0', "delay_s"),
        ('"den": [0.0, 1.0, 2.0]', "num or den"), ('"num": [0.0]', "num or den"),
        ('"band_hz": [300.0, 0.4]', "band_hz"), ('"valid_hz": [5.0]', "valid_hz"), ('"num": [1e200]', "size"),
        ('"excess": {"frequency_hz": [2, 1], "magnitude": [0, 0], "phase_rad": [0, 0]}', "ascend"),
        ('"friction": 3', "friction"), ('"units": null', "units is None"),
        ('"num": [1' + 400 * "0" + "]", "num is not made of numbers"),
    ],
)  # fmt: skip
def test_model__numbers_no_record_leads_to__refused_by_itself_and_in_a_display(tmp_path, change, words) -> None:
    path = tmp_path / "m.json"
    write_model(path, MODEL)
    name = change[: change.index(":")]
    text = re.sub(rf",\n {name}: .*?(?=,\n \"|\n\}})", "", path.read_text(), count=1, flags=re.DOTALL)
    path.write_text(text.rstrip().removesuffix("}") + f", {change}}}")
    one_line(lambda: read_model(path), words)
    channel = {"name": "index", "sensor_gain_v_per_mm": 0.2, "travel_mm": 12.5, "plant": "m.json"}
    document = {"display": {"name": "one", "rate_hz": 4000.0, "delay_samples": 1}, "channel": [channel]}
    one_line(lambda: parse_display({**document, "threshold": {"curve": "bolanowski-1988"}}, tmp_path), "plant|; ")


@pytest.mark.parametrize(
    "text", [b"a = " + b"9" * 5000, b"a = " + b"[" * 5000, b"a." * 50_000 + b"b = 1", b"a = 1 #" * 400_000, b"\xff\xff"]
)
def test_toml__that_no_writer_writes__refused(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "board").mkdir()
    (tmp_path / "board" / "board.toml").write_bytes(text)
    one_line(lambda: read_words(tmp_path / "board" / "board.toml", "en"), "language file")
    one_line(lambda: read_boards(tmp_path), "board.toml")


def test_toml__points_and_spaces_in_a_comment__read_at_once() -> None:
    leaders = f"# contents {'. ' * 60}3\n"  # with two ways for each space: years
    assert parse_toml(f"{leaders}a = 1") == {"a": 1}
    for dots in (" . " * 64, '."a" ' * 64, " .\t'a'" * 64):
        with pytest.raises(BadInput, match="64 parts"):
            parse_toml(f"a{dots} = 1")


def test_record__head_of_a_hundred_thousand_words__read(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text(f"# {'a ' * 100_000}\nu,y\n1,2\n2,3\n4,5\n")
    assert record(tmp_path / "r.csv").command.size == 3


HUNDRED_THOUSAND = 100_000
LONG = ["[", "[a", "a[", "(1 ", "1", "1,", "a.", "e", "m/V", '""', "\u0301"]
"""Texts in which a search that goes back tries every pair of places: minutes, where one that does not takes 0.1 s."""


@pytest.mark.parametrize("piece", LONG)
def test_name_or_cell__of_a_hundred_thousand_characters__takes_time_by_its_length(tmp_path: Path, piece: str) -> None:
    long = piece * (HUNDRED_THOUSAND // len(piece))
    begun = time.process_time()
    column_name(long + ")")
    for cell in (long, f"{long}x", f"1{' ' * len(long)}+2j", f"1+2{' ' * len(long)}x", f"1{' ' * len(long)},x"):
        assert cell_pair(cell) is None or cell.startswith("1 ")
        cell_value(cell)
        taken_for(cell)
    (tmp_path / "r.csv").write_text(f'u,"{long[:30_000]}",y\n' + "1,2,3\n" * 5)
    with suppress(BadInput):
        record(tmp_path / "r.csv")
    assert time.process_time() - begun < 10.0  # a bound for any machine


def test_refusal__of_a_cell_of_thousands_of_characters__is_a_line_that_can_be_read() -> None:
    assert len(str(BadInput("9" * 30_000, "a number"))) < 1100


@pytest.mark.parametrize("name", ["c{}", "c{}.5", "a", "{}"])
def test_table__of_15_000_columns__is_refused_by_their_number_before_a_cell_is_read(
    tmp_path, monkeypatch, name
) -> None:
    read = []
    monkeypatch.setattr("tactuator.io.table_layout.cell_value", lambda cell: (read.append(cell), cell_value(cell))[1])
    for count, refused in ((2000, "which column is which"), (15_000, "a row of 15000 cells; expected up to 2000")):
        read.clear()
        names = ",".join(name.format(k) for k in range(count))
        (tmp_path / "r.csv").write_text(f"{names}\n" + 5 * (",".join(count * ["1"]) + "\n"))
        one_line(lambda: record(tmp_path / "r.csv"), refused)
        assert (len(read) < 100) == (count > 2000)


def test_table__columns_named_alike__takes_time_by_their_number(tmp_path: Path) -> None:
    class Name(str):
        compared = 0

        def __eq__(self, other: object) -> bool:
            Name.compared += 1
            return str(self) == other

        __hash__ = str.__hash__

    names = tuple(Name(f"c{k}.5") for k in range(1000))
    place_of = {name: k for k, name in enumerate(names)}
    assert not any(text_table._is_nothing_new(k, names, place_of, np.ones((2, 1000))) for k in range(1000))
    assert Name.compared < 10_000


def test_error__of_10_000_names__is_a_line_that_can_be_read_in_each_of_its_parts() -> None:
    long = ", ".join(f"name{k}" for k in range(10_000))
    for error in (BadInput(long), BadInput("a", long), BadInput("a", "b", key=long), BadInput("a").within(long, long)):
        assert len(str(error)) < 1100
        assert len(json.dumps(error.document())) < 2200
    assert str(BadInput("a", "b").within("c", "d")) == "c: d: a; expected b"


def test_pipe__that_nobody_writes_to__keeps_neither_a_reader_nor_a_server_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "p.csv")
    one_line(lambda: read_pairs(tmp_path / "p.csv"), "no column .*; expected displacement_mm")
    one_line(lambda: Address(certificate=tmp_path / "p.csv"), "is a pipe")


def test_pipe__that_somebody_writes_to__is_read_to_its_end(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "p.csv")
    writer = subprocess.Popen(["sh", "-c", f"(sleep 0.2; echo 1; sleep 0.2; echo 2) > {tmp_path / 'p.csv'}"])
    with (tmp_path / "p.csv").open("rb") as opened:  # it is open before the reader comes, as a shell's <(...) is
        assert read_content(tmp_path / "p.csv") + opened.read() == b"1\n2\n"
    assert writer.wait(10) == 0
    with pytest.raises(BadInput, match="more than 12 MB"):
        read_content(Path("/dev/zero"))

"""The examples as they are shipped, and the display and protocol files to start from."""

import re
import shutil
import sqlite3
import tomllib
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import replace
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.api.option import option_in
from tactuator.cli.commands import COMMANDS
from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import StudyProtocol, read_protocol
from tactuator.experiment.store.store import Store
from tactuator.io import text_table
from tactuator.io.atomic import atomic_folder, atomic_path, write_text
from tactuator.io.columns import read_columns
from tactuator.io.controller import write_controller
from tactuator.io.csv_tables import (
    read_contours,
    read_curve,
    read_matrix,
    read_pairs,
    read_relative_curve,
    resolve_curve,
    write_contours,
    write_curve,
)
from tactuator.io.display import parse_display, read_display
from tactuator.io.environment import write_environment
from tactuator.io.kinds import KINDS, kind_of
from tactuator.io.model import write_model
from tactuator.io.record import read_measured, read_record, write_record
from tactuator.io.reference import ReferenceHead, open_reference, write_reference
from tactuator.io.response import write_responses
from tactuator.io.response_table import are_of_response
from tactuator.io.shipped import (
    DISPLAY_KINDS,
    EXAMPLES,
    copy_examples,
    display_template,
    example_names,
    with_model,
)
from tactuator.io.text_table import last_number_cut_off, read_table
from tactuator.model.description import TABLES, keys_of
from tactuator.model.plant_model import PlantModel
from tactuator.perception.contours import Contours
from tactuator.perception.curve import Contact, ThresholdCurve
from tactuator.signals.record import Record, Response
from tactuator.signals.systems import ContinuousSystem
from tactuator.speech.coding import coding_of, read_coding
from tactuator.speech.reading import scan_speech
from tests.measure.loops import controller, display
from tests.program import Program

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
    "protocol.toml": lambda path: read_protocol(path, StudyProtocol),
    "protocols/*.toml": lambda path: read_protocol(path, StudyProtocol),
    "protocols/*.wav": open_reference,
    "bench.csv": lambda path: read_record(path, input="drive", output="encoder", time="t"),
    "sheet.csv": read_measured,
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
    assert are_of_response(read_columns(EXAMPLES / "sheet.csv"))
    assert not are_of_response(read_columns(EXAMPLES / "bench.csv"))
    display = read_display(EXAMPLES / "display.toml")
    head = open_reference(EXAMPLES / "protocols" / "a.wav").head
    assert (head.rate_hz, head.channels) == (display.rate_hz, tuple(channel.name for channel in display.channels))
    assert read_coding(EXAMPLES / "coding.toml") == coding_of("envelope")


def test_copy__into_a_folder__has_every_byte_and_writes_nothing_over(tmp_path):
    folder = tmp_path / "new" / "deep"
    written = copy_examples(folder)
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert [path.relative_to(folder).as_posix() for path in written] == list(example_names())
    assert [path.read_bytes() for path in written] == [(EXAMPLES / name).read_bytes() for name in example_names()]
    copy_examples(folder)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    (other := tmp_path / "other").mkdir()
    (other / "speech.wav").write_text("my own", encoding="ascii")
    with pytest.raises(BadInput, match=r"speech\.wav is there already"):
        copy_examples(other)
    assert [path.name for path in other.rglob("*")] == ["speech.wav"]


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


MODEL = PlantModel(
    np.array([2740.0]), np.array([1.0, 97.0, 305.0]), 0.0, np.zeros((4, 4)), (0.4, 300.0), friction={"coulomb": 8e-3}
)


@pytest.mark.parametrize("kind", DISPLAY_KINDS)
def test_display_template__each_kind__is_one_channel_and_has_every_key_for_a_person(kind):
    text = display_template(kind)
    assert len(parse_display(tomllib.loads(text)).channels) == 1
    assert max(map(len, text.splitlines())) <= 120
    for name in TABLES:
        part = re.search(rf"(?ms)^(# )?\[+{name}\]+.*?(?=^(# )?\[|\Z)", text)[0]
        keys = set(re.findall(r"^(?:# )?(\w+) = ", part, flags=re.MULTILINE))
        assert keys == set(keys_of(name)) - INTERNAL
        assert all("  # " not in line or line.split("  # ")[1].strip() for line in part.splitlines())


INTERNAL = {
    "family", "models", "covariance", "valid_hz", "model_error_db", "model_error_hz", "recorded", "unchanged",
    "assumed",
}  # fmt: skip
ALONE = {
    "mass_kg": "quantity", "sensor_gain_v_per_n": "sensor_gain", "controller": "structure", "measured": "measured",
    "contours": "contours.csv", "adaptive": "touch", "loads": "load",
}  # fmt: skip
"""Keys that are refused, or need a file, beside what a template says; a word of the refusal."""


@contextmanager
def suppressed(word: str) -> Iterator[None]:
    try:
        yield
    except BadInput as error:
        if word not in str(error):
            raise


@pytest.mark.parametrize(("command", "position"), [("V", "mm"), ("V", "um"), ("mV", "m"), ("V", "mV")])
def test_display__model_in_other_units__is_that_of_the_sensors_volts(command, position, tmp_path):
    volts = {"V": 1.0, "mV": 1e-3, "mm": 2.0, "um": 2e-3, "m": 2e3}  # of a sensor of 2 V/mm
    scale = volts[command] / volts[position]
    of_row = np.array([scale, 1.0, 1.0, 1.0])
    friction = {"coulomb": 8e-3 / volts[command], "presliding": 1e-2 / volts[position]}
    changed = {"friction": friction, "record": {"rate_hz": 4e3, "position_half_span": 1.5 / volts[position]}}
    model = replace(MODEL, friction={"coulomb": 8e-3, "presliding": 1e-2}, covariance=np.diag([4.0, 0.1, 0.2, 0.0]),
                    record={"rate_hz": 4e3, "position_half_span": 1.5})  # fmt: skip
    other = replace(model, num=model.num * scale, covariance=of_row[:, None] * model.covariance * of_row,
                    command_unit=command, position_unit=position, **changed)  # fmt: skip
    read = []
    for name, of in {"volts.json": model, "other.json": other}.items():
        write_model(tmp_path / name, of, of.family(2, np.random.default_rng(0)))
        text = with_model(display_template("voice-coil"), of, name)
        assert re.findall("(?m)^([a-z_]+) = .*CHANGE THIS", text)[0] == "sensor_gain_v_per_mm"
        (tmp_path / "d.toml").write_text(text)
        read.append(read_display(tmp_path / "d.toml").channels[0])
    if position != "mV":
        (tmp_path / "d.toml").write_text(text.replace("[[channel]]", '[[channel]]\nquantity = "velocity"'))
        with pytest.raises(BadInput, match="quantity is 'velocity', and the plant is of displacement"):
            read_display(tmp_path / "d.toml")
    plain, converted = read
    for a, b in zip((plain.plant, *plain.family), (converted.plant, *converted.family), strict=True):
        np.testing.assert_allclose(a.response([1.0, 30.0]), b.response([1.0, 30.0]), rtol=1e-9)
    np.testing.assert_allclose(plain.covariance, converted.covariance)
    assert converted.recorded.position == pytest.approx(plain.recorded.position)
    for key in ("friction_v", "presliding_v"):
        assert getattr(converted.environment, key) == pytest.approx(getattr(plain.environment, key))


def test_display__response_in_micrometres__is_that_of_the_sensors_volts(tmp_path):
    hertz = np.geomspace(20.0, 500.0, 120)
    size = np.abs(ContinuousSystem.from_polynomials([4e6], [1.0, 300.0, 1e6]).response(hertz))
    text = re.sub(r"(?m)^plant = \{[^}]*\}", 'plant = "r.csv"', display_template("exciter"))
    (tmp_path / "d.toml").write_text(re.sub("(?m)^loads = .*", "", text))
    plants = []
    for unit, volts in {"V/V": 1.0, "um/V": 5e-3}.items():
        rows = "".join(f"{f},{m / volts}\n" for f, m in zip(hertz, size, strict=True))
        (tmp_path / "r.csv").write_text(f"frequency (Hz),magnitude ({unit})\n{rows}")
        plants.append(read_display(tmp_path / "d.toml").channels[0].plant.response(hertz))
    np.testing.assert_allclose(np.abs(plants[0]), np.abs(plants[1]), rtol=1e-6)


@pytest.mark.parametrize("kind", [*DISPLAY_KINDS, "model"])
def test_template__each_commented_line__is_toml_and_of_the_right_type(kind):
    text = display_template(DISPLAY_KINDS[0] if kind == "model" else kind)
    text = with_model(text, MODEL, "model.json") if kind == "model" else text
    commented = r"(?m)^# (?=\w+ = |\[)"
    tables = tomllib.loads(re.sub(commented, "", text))
    assert INTERNAL.isdisjoint(key for table in (tables | {"channel": tables["channel"][0]}).values() for key in table)
    text = re.sub(r'(?m)^plant = "model.json"', "plant = { num = [2740.0], den = [1.0, 97.0, 305.0] }", text)
    for line in re.finditer(r"(?m)^# (\w+) = .*", text):
        name = re.findall(r"(?m)^(?:# )?\[+(\w+)\]+", text[: line.start()])[-1]
        head = re.sub(rf"(?m)^# (?=\[{name}\])", "", text[: line.start()])
        if name == "sound":  # without volts at full scale it is refused
            head += "" if line[1] == "output_full_scale_v" else "output_full_scale_v = 2.0\n"
        whole = head + line[0].removeprefix("# ") + text[line.end() :]
        with nullcontext() if (word := ALONE.get(line[1])) is None else suppressed(word):
            parse_display(tomllib.loads(whole))


@pytest.mark.parametrize("kind", DISPLAY_KINDS)
def test_with_model__each_kind__has_the_plant_and_its_friction(kind, tmp_path):
    write_model(tmp_path / "my model.json", MODEL)
    (tmp_path / "display.toml").write_text(with_model(display_template(kind), MODEL, "my model.json"))
    display = read_display(tmp_path / "display.toml")
    (channel,) = display.channels
    assert channel.plant.polynomials()[1] == pytest.approx([1.0, 97.0, 305.0])
    assert channel.environment.friction_v == 8e-3
    assert channel.loads == ()
    assert channel.environment.assumed == ("hum", "noise", "presliding")  # nobody measured them: they are not judged
    assert channel.unchanged == ("sensor_gain_v_per_mm", "travel_mm", "bits", "range_v")
    text = (tmp_path / "display.toml").read_text()
    assert "# hum_hz = [60.0, 120.0, 180.0]  # lines" in text  # what holds, not what the template had
    assert "# friction_v = 0.008  # default: the model's; Coulomb" in text
    assert not display.touch.adaptive  # what is learnt of a load wants one: the file could not be designed


def test_template__of_another_band__is_narrowed_or_refused(tmp_path):
    narrow = replace(MODEL, valid_hz=(2.0, 120.0), quantity="velocity")
    write_model(tmp_path / "model.json", narrow)
    (tmp_path / "display.toml").write_text(with_model(display_template("tactuator"), narrow, "model.json"))
    (channel,) = read_display(tmp_path / "display.toml").channels
    assert channel.threshold.band_hz == (2.0, 120.0)
    assert channel.quantity == "velocity"
    with pytest.raises(BadInput, match="band of this kind"):
        with_model(display_template("lra"), replace(MODEL, valid_hz=(0.1, 20.0)), "model.json")


FILES = {
    "display": "bench.toml", "record": "record.h5", "record in text": "bench.csv", "response": "sheet.csv",
    "measured": "measured.h5", "model": "model.json", "controller": "controller.json", "image": "image.bin",
    "reference": "reference.wav", "reference in HDF5": "reference.h5", "sound": "speech.wav",
    "protocol": "protocol.toml", "store": "store.sqlite", "curve": "curve.csv", "loss": "loss.csv",
    "pairs": "pairs.csv", "environment": "environment.json", "matrix": "confusion.csv", "coding": "coding.toml",
    "contours": "contours.csv",
}  # fmt: skip
VERBS = {
    "design FILE": {"display"},
    "design GOOD/bench.toml --curve FILE": {"curve"},
    "check FILE": {"controller"},
    "check GOOD/controller.json --display FILE": {"display"},
    "firmware wordlength FILE": {"controller"},
    "build FILE --out GOOD/new.bin": {"controller"},
    "firmware image FILE": {"image"},
    "firmware image GOOD/image.bin --controller FILE": {"controller"},
    "identify FILE": {"record", "response", "measured", "sound"},
    "identify GOOD/record.h5 --validate FILE": {"record", "response", "sound"},
    "calibrate FILE": {"pairs"},
    "record FILE --out GOOD/new.h5": {"display"},
    "measure response --controller FILE": {"controller"},
    "measure response --display FILE": {"display"},
    "measure noise --controller FILE": {"controller"},
    "measure disturbance --controller FILE": {"controller"},
    "measure load --controller FILE": {"controller"},
    "init --from FILE --out GOOD/new.toml": {"model"},
    "render FILE --controller GOOD/controller.json --out GOOD/new.wav": {"sound"},
    "render GOOD/speech.wav --coding FILE --controller GOOD/controller.json --out GOOD/new.wav": {"coding"},
    "play FILE --controller GOOD/controller.json": {"reference", "sound"},
    "experiment serve FILE --store GOOD/new.sqlite": {"protocol"},
    "experiment thresholds --store FILE": {"store"},
    "experiment export --store FILE --out GOOD/new": {"store"},
    "experiment information --store FILE": {"store"},
    "experiment information --matrix FILE": {"matrix"},
    "experiment simulate --procedure curve --truth FILE": {"loss"},
    "sound calibrate-display FILE": {"display"},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    lab = tmp_path_factory.mktemp("lab")
    shutil.copytree(EXAMPLES, lab, dirs_exist_ok=True)
    designed, rng, two = controller(display()), np.random.default_rng(0), np.ones(2)
    write_controller(lab / "controller.json", designed)
    assert main(["build", str(lab / "controller.json"), "--out", str(lab / "image.bin")]) == 0
    model = PlantModel(np.array([2875.0]), np.array([1.0, 94.0, 290.0]), 0.0, np.zeros((4, 4)), (0.4, 300.0))
    write_model(lab / "model.json", model)
    write_record(lab / "record.h5", Record(1000.0, rng.standard_normal(500), rng.standard_normal(500)))
    flags = np.zeros(2, dtype=bool)
    measured = Response("index", "none", 20.0, "multisine", np.array([1.0, 2.0]), two + 0j, two, two, two, two, flags,
                        flags, two)  # fmt: skip
    write_responses(lab / "measured.h5", [measured])
    for name in ("reference.wav", "reference.h5"):
        with write_reference(lab / name, ReferenceHead(4000.0, ("index",))) as writer:
            writer.write(np.zeros((400, 1)))
    Store(lab / "store.sqlite").close()
    write_environment(lab / "environment.json", {"index": {}})
    write_contours(lab / "contours.csv", Contours("P1", [30.0, 300.0], [20.0], [[20.0, 20.0]]))
    return lab


def test_kind__file_of_each_noun__is_known_by_its_content_alone(folder: Path, tmp_path: Path) -> None:
    for noun, name in FILES.items():
        moved = tmp_path / f"anything{Path(name).suffix if noun.startswith('reference') else ''}"
        shutil.copy(folder / name, moved)
        assert kind_of(moved) == noun.split()[0]


@pytest.mark.parametrize("command", VERBS)
def test_verb__file_of_another_kind__says_what_it_is_and_what_takes_it(command: str, folder: Path, capfd) -> None:
    """Three other kinds at each verb, and each kind at three verbs or more."""
    refused = Program(capfd, folder).refused
    first = 3 * list(VERBS).index(command) % len(FILES)
    others = [noun for noun in [*FILES][first:] + [*FILES][:first] if noun.split()[0] not in VERBS[command]]
    for noun in others[:3]:
        kind, name = KINDS[noun.split()[0]], FILES[noun]
        words = command.replace("FILE", str(folder / name)).replace("GOOD", str(folder)).split()
        refused(*words, said=f"this is {kind.words}: {kind.goes}; expected ")


WRITERS = {
    "record GOOD/bench.toml --out FILE": "record",
    "identify GOOD/record.h5 --out FILE": "model",
    "design GOOD/bench.toml --out FILE": "controller",
    "build GOOD/controller.json --out FILE": "image",
    "measure response --controller GOOD/controller.json --out FILE": "measured",
    "measure noise --controller GOOD/controller.json --write FILE": "environment",
    "render GOOD/speech.wav --controller GOOD/controller.json --out FILE": "reference",
    "render GOOD/speech.wav --controller GOOD/controller.json --out GOOD/new.wav --felt FILE": "reference",
    "render GOOD/speech.wav --controller GOOD/controller.json --out GOOD/new.wav --save-coding FILE": "coding",
    "experiment thresholds --store GOOD/store.sqlite --curve-out FILE": "curve",
    "experiment contours GOOD/store.sqlite --out FILE": "contours",
    "experiment backup GOOD/store.sqlite FILE": "store",
}


@pytest.mark.parametrize(("command", "kind"), WRITERS.items(), ids=WRITERS)
def test_written__over_a_file_of_another_kind__is_refused_first(command, kind, folder, tmp_path, capfd) -> None:
    refused = Program(capfd, folder).refused
    (folder / "notes.csv").write_text("clock;amp;stage\n0;1;2\n")
    for noun, name in {**FILES, "notes": "notes.csv"}.items():
        there = Path(shutil.copy(folder / name, tmp_path / name))
        if noun.startswith("reference") and there.suffix == ".wav":
            shutil.copy(folder / "reference.json", tmp_path)
        if (is_ := noun.split()[0]) != kind or kind == "store":
            words = KINDS[is_].words if is_ in KINDS else "another file"
            arguments = command.replace("FILE", str(there)).replace("GOOD", str(folder)).split()
            refused(*arguments, said=f"{there} is {words} already; expected another name for {KINDS[kind].words}")
            assert there.read_bytes() == (folder / name).read_bytes()


def test_writers__every_option_that_writes_a_file__is_among_them() -> None:
    parameters = (each for command in COMMANDS.values() for each in signature(command.function()).parameters.values())
    written = [option.writes for each in parameters if (option := option_in(each.annotation)) is not None]
    # figures and exports are folders; a merged store is refused by itself
    assert sorted(kind for kind in written if kind not in ("", "folder")) == sorted([*WRITERS.values(), "store"])


def test_kind__of_what_is_none__is_not_guessed(tmp_path: Path) -> None:
    for name, content in {"a.csv": b"", "b.json": b"{}", "c.toml": b"x = 1", "d.bin": bytes(200)}.items():
        (tmp_path / name).write_bytes(content)
        assert kind_of(tmp_path / name) is None
    assert kind_of(tmp_path) is None
    assert kind_of(tmp_path / "nothing") is None
    (sound := tmp_path / "sound.json").write_bytes(b"OggS")
    assert kind_of(sound) == "sound"


PALM = Contact("thenar", 290.0, "rigid, gap 1 mm", 0.5, (20.0, 31.5))


def test_write_curve__with_errors_and_contact__is_read_back_whole(tmp_path: Path) -> None:
    hertz, level, origin = [1.0, 10.0, 300.0], [26.0, 19.1, -18.0], ("measured", "three observers")
    curve = ThresholdCurve("mine", hertz, level, *origin, np.ones(3), contact=PALM)
    write_curve(tmp_path / "mine.csv", curve)
    again = read_curve(tmp_path / "mine.csv")
    assert again == curve
    assert (again.provenance, again.source, again.contact) == (*origin, PALM)
    assert again.standard_error_db is not None
    fingers = "frequency_hz,level_db_re_1um,finger\n1,2,index;thumb\n2,3,index;thumb\n3,4,index\n"
    (tmp_path / "fingers.csv").write_text(fingers)
    assert read_curve(tmp_path / "fingers.csv").level_db_re_1um.tolist() == [2.0, 3.0, 4.0]
    (tmp_path / "c.csv").write_text("frequency_hz,level_db_re_1um\n1,2\n2,3\n3,4\n")
    assert resolve_curve("bolanowski-1988", tmp_path).name == "bolanowski-1988"
    read = resolve_curve("c.csv", tmp_path)
    assert (read.level_db_re_1um.tolist(), read.provenance) == ([2.0, 3.0, 4.0], "not stated")


TABLE = np.array([[10.0, 10.1, 12.0], [20.0, 20.3, 1.0 / 3.0 + 25.0]])


@pytest.mark.parametrize("band", [(TABLE - 1.0, TABLE + 1.5), (None, None)], ids=["banded", "plain"])
def test_write_contours__with_a_band_or_without__is_read_back_whole(tmp_path: Path, band) -> None:
    origin = (63.0, "measured", "matches, one person", PALM)
    there = Contours("P7", [63.0, 64.0, 250.0], [10.0, 20.0], TABLE, *band, *origin)
    write_contours(tmp_path / "contours.csv", there)
    again = read_contours(tmp_path / "contours.csv")
    assert again == there
    assert (again.reference_hz, again.source, again.contact) == (63.0, "matches, one person", PALM)
    np.testing.assert_array_equal(
        again.level_db_sl_at([5.0, 15.0, 60.0], 100.0), there.level_db_sl_at([5, 15, 60], 100)
    )
    np.testing.assert_array_equal(again.high_db_sl, band[1])
    (tmp_path / "c.csv").write_text("level_db_sl,frequency_hz,db_sl\n10,100,10\n10,250,12\n")
    assert read_contours(tmp_path / "c.csv").provenance == "not stated"


@pytest.mark.parametrize(
    ("text", "stimuli", "responses"),
    [
        ("5,1\n2,6\n", ("1", "2"), ("1", "2")),
        ("# a comment\npa,ba\n5,1\n2,6\n", ("1", "2"), ("pa", "ba")),
        (",pa,ba\npa,5,1\nba,2,6\n", ("pa", "ba"), ("pa", "ba")),
        ("stimulus,1,2\n1,5,1\n2,2,6\n", ("1", "2"), ("1", "2")),
        ("pa,5,1\nba,2,6\n", ("pa", "ba"), ("1", "2")),
        ("\ufeff,1,2\n1, 5 ,1\n2,2,6\n", ("1", "2"), ("1", "2")),
    ],
)
def test_read_matrix__with_and_without_names__same_counts(tmp_path, text, stimuli, responses):
    path = tmp_path / "matrix.csv"
    path.write_text(text, encoding="utf-8")
    got = read_matrix(path)
    np.testing.assert_array_equal(got.counts, [[5, 1], [2, 6]])
    assert got.stimuli == stimuli
    assert got.responses == responses


FORMS = ("{!r}", "{:.17g}", "{:.3e}", "{:.6f}", "{:+.4f}", "{:E}", " {:.12g} ")
DELIMITERS = {",": ".", ";": ",", "\t": ","}


@given(
    numbers=st.lists(st.floats(-1e12, 1e12), min_size=3, max_size=60),
    form=st.sampled_from(FORMS),
    mark=st.sampled_from(sorted(DELIMITERS)),
    end=st.sampled_from(["\n", "\r\n"]),
    piece=st.integers(10, 400),
)
def test_read_table__numbers_in_any_form__are_those_of_float(tmp_path_factory, numbers, form, mark, end, piece) -> None:
    rows = [numbers[k : k + 3] for k in range(0, len(numbers) // 3 * 3, 3)]
    cells = [[form.format(value) for value in row] for row in rows]
    path = tmp_path_factory.getbasetemp() / "t.csv"
    lines = ["a" + mark + "b" + mark + "c", *(mark.join(row).replace(".", DELIMITERS[mark]) for row in cells)]
    path.write_bytes(end.join(lines).encode())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text_table, "_PIECE_CHARACTERS", piece)
        table = read_table(path, 1000, 10000)
    assert table.names == ("a", "b", "c")
    assert not table.cut
    np.testing.assert_array_equal(table.values, [[float(cell) for cell in row] for row in cells])


@pytest.mark.parametrize(
    "text",
    ["1,2\n3,nan\n5,6\n", "1,2\n\n# a remark\n3,x\n5,6\n", '1,2\n"3",\n5,6\n', "1,2\n3,0x1\n5,6\n", "1,2\r3,1_0_\r5,6"],
)
def test_read_table__an_odd_row_among_numbers__is_nan_where_it_is_none(tmp_path: Path, text: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text, newline="")
    np.testing.assert_array_equal(read_table(path, 100, 1000).values, [[1.0, 2.0], [3.0, np.nan], [5.0, 6.0]])


@pytest.mark.parametrize("text", ["1,2\n3,4\n5\n", "1,2\n3,4\n5,6,7\n", "1,2\n3,4 5\n1\n"])
def test_read_table__rows_of_several_lengths__are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(BadInput, match="columns"):
        read_table(path, 100, 1000)


@pytest.mark.parametrize(("most", "read", "cut"), [(9, 9, True), (10, 10, False), (11, 10, False)])
def test_read_table__limit_of_rows__is_kept_and_told(tmp_path, monkeypatch, most, read, cut) -> None:
    path = tmp_path / "t.csv"
    path.write_text("".join(f"{k},{k}\n" for k in range(10)) + "\n\n")
    monkeypatch.setattr(text_table, "_PIECE_CHARACTERS", 10)
    table = read_table(path, most, 1000)
    assert (table.values[:, 1].tolist(), table.cut) == (list(range(read)), cut)
    table = read_table(path, most, 12)
    assert (len(table.values), table.cut) == (6, True)


def test_read_table__long_remarks__are_passed_over_or_refused(tmp_path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("# remark\n" * 5000 + "t,u\n0,1.5\n1,2.5\n")
    table = read_table(path, 10, 100)
    assert (table.names, table.values.tolist(), table.cut) == (("t", "u"), [[0.0, 1.5], [1.0, 2.5]], False)
    path.write_text("# remark\n" * 100_001 + "t,u\n0,1.5\n")
    with pytest.raises(BadInput, match="remarks fill its first 100000 lines"):
        read_table(path, 10, 100)


def written(folder: Path, form: str, delimiter: str = ",", rows: int = 400) -> Path:
    path, values = folder / "record.csv", np.random.default_rng(3).normal(0.0, 30.0, (rows, 2))
    np.savetxt(path, values, fmt=form, delimiter=delimiter, header="u,y".replace(",", delimiter), comments="")
    return path


@pytest.mark.parametrize(("form", "delimiter"), [("%.4f", ","), ("%.6e", ","), ("%.6e", "\t"), ("%.3f", ";")])
def test_last_number__file_cut_anywhere_within_it__is_found(tmp_path: Path, form: str, delimiter: str) -> None:
    path = written(tmp_path, form, delimiter)
    whole = path.read_bytes().rstrip()
    last = whole.decode().rpartition(delimiter)[2]
    for there in range(1, len(last)):
        path.write_bytes(whole[: there - len(last)])
        assert last_number_cut_off(path) == last[:there]
    for content in (whole, whole + b"\n"):  # a whole file, without the last line's end too
        path.write_bytes(content)
        assert last_number_cut_off(path) is None


def test_read_columns__file_cut_off__last_row_is_left_out_and_told(tmp_path: Path) -> None:
    path = written(tmp_path, "%.4f", rows=30)
    path.write_bytes(path.read_bytes().rstrip()[:-2])
    assert last_number_cut_off(path) is None  # nothing tells
    path = written(tmp_path, "%.4f")
    path.write_bytes(path.read_bytes().rstrip()[:-2])
    columns = read_columns(path)
    assert columns.values["y"].size == 399
    (remark,) = columns.remarks
    assert "ends within its last number" in remark


OURS = frozenset({"a.txt"})


def test_atomic__error_in_the_middle__leaves_the_old_file_and_no_folder(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    write_text(target, "old", None)
    with pytest.raises(KeyboardInterrupt), atomic_path(target, None) as beside:
        beside.write_text("half")
        raise KeyboardInterrupt
    assert target.read_text() == "old"
    with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "deep" / "report", OURS) as beside:
        (beside / "a.txt").write_text("half")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == [target]


def test_atomic__store_of_an_experiment_no_folder_or_a_file_in_the_way__is_refused(tmp_path: Path) -> None:
    target = tmp_path / "study.db"
    with closing(sqlite3.connect(target)) as store:
        store.execute("CREATE TABLE answer (id INTEGER)")
    before = target.read_bytes()
    with pytest.raises(BadInput, match="store of an experiment"):
        write_text(target, "frequency_hz,level_db_sl", "curve")
    assert target.read_bytes() == before
    write_text(tmp_path / "file", "x", None)
    # a folder that even root cannot write to is in /proc
    for writing, words in (
        (atomic_path(tmp_path / "none" / "a.txt", None), "is not a folder"),
        (atomic_folder(tmp_path / "file", OURS), "is a file; expected a folder"),
        (atomic_folder(tmp_path / "file" / "below" / "c", OURS), "cannot be made"),
        (atomic_folder("/proc/none/report", OURS), r"cannot be (made|written)"),
    ):
        with pytest.raises(BadInput, match=words), writing:
            pass


def test_atomic_folder__whole__takes_the_place_of_the_old(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("report")
    (tmp_path / "report").mkdir()
    for name in ("report", "link"):
        with atomic_folder(tmp_path / name, OURS) as beside:
            (beside / "a.txt").write_text(name)
        assert (tmp_path / "report" / "a.txt").read_text() == name
    assert (tmp_path / "link").is_symlink()
    assert sorted(tmp_path.iterdir()) == [tmp_path / "link", tmp_path / "report"]


def test_atomic_folder__files_of_others__are_kept_and_it_is_refused(tmp_path: Path) -> None:
    target = tmp_path / "report"
    target.mkdir()
    with pytest.raises(BadInput, match=r"holds other files \(thesis\.tex"), atomic_folder(target, OURS) as beside:
        (beside / "a.txt").write_text("new")
        (target / "thesis.tex").write_text("years of work")
    with pytest.raises(BadInput, match="holds other files"), atomic_folder(target, OURS):
        pass
    assert (target / "thesis.tex").read_text() == "years of work"
    assert list(tmp_path.iterdir()) == [target]


def test_atomic_folder__interrupted_between_the_renames__puts_the_old_one_back(tmp_path: Path, monkeypatch) -> None:
    target = tmp_path / "report"
    target.mkdir()
    (target / "a.txt").write_text("old")
    rename, calls = Path.rename, []

    def interrupted_second(self: Path, to: Path) -> Path:
        calls.append(to)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return rename(self, to)

    monkeypatch.setattr(Path, "rename", interrupted_second)
    with pytest.raises(KeyboardInterrupt), atomic_folder(target, OURS) as beside:
        (beside / "a.txt").write_text("new")
    assert (target / "a.txt").read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]

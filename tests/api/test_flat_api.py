"""The flat API: its names, its examples as they are printed, and the manners of its results."""

import doctest
import inspect
import json
import pydoc
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

import tactuator as tt
from tactuator.api.start import curves
from tactuator.cli import main
from tactuator.errors import BadInput
from tactuator.io.csv_tables import write_curve
from tactuator.io.reference import open_reference
from tactuator.model.plant import Load
from tactuator.paper.reproduce import PaperResult
from tactuator.perception.curve import Contact, ThresholdCurve, curve_names
from tactuator.plain import finite
from tactuator.result import Result
from tactuator.signals.record import Record
from tactuator.speech.coding import coding_of

NAMES = [name for name in dir(tt) if name != "__version__"]
FUNCTIONS = [name for name in NAMES if not hasattr(getattr(tt, name), "exit_status")]
PROTOCOL = """
[study]
name = "one"
seed = 1
[procedure]
kind = "quest-plus"
trials = 6
[conditions]
fingers = ["index"]
frequencies_hz = [250]
[[subject]]
code = "S1"
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("examples")
    tt.examples(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("small.toml").write_text(PROTOCOL)
        measured = ["measure", "response", "--display", "display.toml", "--frequency-hz", "30", "--channel", "index"]
        assert main([*measured, "--out", "response.h5", "--json"]) == 0
        assert main(["experiment", "observe", "small.toml", "--store", "lab.db", "--seed", "1", "--json"]) == 0
        yield folder


@pytest.fixture(scope="module")
def known(place: Path) -> dict[str, object]:
    controller = tt.design("display.toml")
    return {"tt": tt, "np": np, "controller": controller, "rig": tt.SimulatedRig(controller.display, seed=1)}


def errors_below(kind: type[Exception]) -> set[type[Exception]]:
    return {kind}.union(*map(errors_below, kind.__subclasses__()))


def test_names__at_most_42__all_there_as_the_types_and_help_say_and_light_to_import():
    assert len(FUNCTIONS) <= 42
    assert set(tt.__all__) == set(NAMES)
    assert set(NAMES) - set(FUNCTIONS) == {error.__name__ for error in errors_below(tt.TactuatorError)}
    listed = pydoc.plain(pydoc.render_doc(tt))
    assert listed.index("calibrate_sensor, record, identify") < listed.index("design, check, word_length")
    assert all(f"\n    {name}(" in listed for name in FUNCTIONS if not isinstance(getattr(tt, name), type))
    assert all(getattr(tt, name) is not None for name in NAMES)
    typed = Path(tt.__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    assert sorted(re.findall(r"import (\w+) as \1\n", typed)) == sorted(NAMES)
    with pytest.raises(AttributeError, match="no attribute 'desing'"):
        tt.desing  # noqa: B018
    assert str(inspect.signature(tt.check)).startswith("(controller: tactuator.model.controller.Controller | str")
    assert not [name for name in NAMES if "Annotated" in str(inspect.signature(getattr(tt, name)))]
    program = "import sys, tactuator; print({'numpy', 'scipy', 'pydantic', 'matplotlib'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).stdout == "set()\n"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ("identify(None)", "identify: records is None; it must be a Record or a FrequencyResponse or"),
        ("identify(['a.csv', 5])", "identify: records is a list; it must be "),
        (
            "design(5)",
            "design: display is 5; it must be a Display (tt.read_display reads a file; of a plant: tt.Display(",
        ),
        ("design('display.toml', error_db=float('nan'))", "design: error_db is nan; it must be a number or None"),
        ("design('display.toml', poles='4')", "design: poles is '4'; it must be a whole number or None"),
        ("check(controller.display)", "check: controller is a Display; it must be a Controller or the path of a file"),
        ("check(controller, monte_carlo=-5)", "check: monte_carlo is -5; it must be 0 to 1000000"),
        (
            "SimulatedRig('display.toml')",
            "SimulatedRig: display is 'display.toml'; it must be a Display (tt.read_display reads",
        ),
        (
            "calibrate_sensor([1], [2])",
            "calibrate_sensor: pairs is a list; it must be the path of a file, or a tuple of ",
        ),
        ("Channel('a', 1.0, 1.0, plant=5)", "[[channel]]: plant is 5; it must be (num, den), a table { zeros, poles, "),
        ("measure_response('simulated')", "neither `display` nor `controller`; expected one of them"),
        ("SimulatedRig(controller.display, seed='a')", "SimulatedRig: seed is 'a'; it must be a whole number"),
        (
            "render('speech.wav', None, 'x.wav', level_db_sl='loud')",
            "render: level_db_sl is 'loud'; it must be a number",
        ),
        ("measure_noise(rig, controller, seed=-1)", "measure_noise: seed is -1; it must be 0 or more"),
        (
            "measure_noise(rig, controller, gains=['a'])",
            "gains is ['a']; it must be real numbers, in a list or in a text",
        ),
        ("measure_response(rig, controller, [[1.0], [2.0, 3.0]])", "frequency_hz is [[1.0], [2.0, 3.0]]; it must be"),
        (
            "measure_rejection(rig, controller, frequency_hz=np.array([1j]))",
            "frequency_hz is array([0.+1.j]); it must be",
        ),
        (
            "measure_rejection(rig, controller, frequency_hz=np.ones((2, 2)))",
            "frequency_hz is array([[1., 1.], [1., 1.]])",
        ),
        (
            "measure_rejection(rig, controller, frequency_hz=[5.0, float('nan')])",
            "frequencies [5.0, nan] Hz; expected above 0",
        ),
        (
            "calibrate_sensor((['a'] * 4, [1.0, 2.0, 3.0, 4.0]))",
            "pairs is ['a', 'a', 'a', 'a']; it must be real numbers",
        ),
        ("identify([])", "no record; expected one or more"),
        ("identify(())", "no record; expected one or more"),
        (
            "calibrate_sensor(())",
            "calibrate_sensor: pairs is a tuple; it must be the path of a file, or a tuple of displacement_mm and",
        ),
        ("read_controller(None)", "read_controller: path is None; it must be the path of a file"),
    ],
)
def test_verb__argument_of_another_kind_or_out_of_bounds__says_what_is_allowed(known, call: str, words: str):
    with pytest.raises(tt.BadInput, match=f"^{re.escape(words)}"):
        eval(f"tt.{call}", known)


@pytest.mark.parametrize("name", [*FUNCTIONS, "BadInput"])
def test_example__of_each_name__runs_as_printed(name: str, known: dict[str, object]):
    text = inspect.getdoc(getattr(tt, name))
    assert ">>> " in text
    example = doctest.DocTestParser().get_doctest(text, dict(known), name, None, None)
    found = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example)
    assert (found.failed, found.attempted > 0) == (0, True)


def results(known: dict[str, object]) -> list[Result]:
    controller, rig = known["controller"], known["rig"]
    record = tt.read_record("bench.csv", input="drive", output="encoder", time="t")
    identified = tt.identify(record, order=2, zeros=0, hold="zero-order", friction=False)
    identified.write("model.json")
    return [
        record, identified, controller, controller.display and tt.read_display("display.toml"), tt.check(controller),
        tt.read_curve("curve.csv"), tt.read_model("model.json"),
        tt.calibrate_sensor("pairs.csv"), tt.build_image(controller),
        tt.measure_response(rig, controller, [30.0, 100.0]), tt.measure_noise(rig, controller, duration_s=4.0),
        tt.render("speech.wav", controller, "spoken.wav"), tt.play(rig, controller, "protocols/a.wav"),
        tt.thresholds("lab.db"), PaperResult(Path("out"), {"seed": 1}, (("what", "printed", "here", "rests on"),)),
        tt.word_length(controller), tt.record("display.toml", duration_s=4.0, excitation="noise"),
        tt.measure_rejection(rig, controller, channel=["index"], frequency_hz=[5.0]), tt.init(out="mine too.toml"),
        tt.measure_crosstalk(rig, controller, [30.0, 100.0]),
    ]  # fmt: skip


def test_results__each__prints_draws_and_tabulates_itself(known: dict[str, object], monkeypatch: pytest.MonkeyPatch):
    mpl.use("svg")
    frames = type(sys)("pandas")
    frames.DataFrame = dict
    monkeypatch.setitem(sys.modules, "pandas", frames)
    for one in results(known):
        assert 10 < len(repr(one)) < 500
        assert one._repr_html_().startswith("<table>")
        assert one.to_dict()
        assert one.all_tables()
        assert 0 < len(str(one).splitlines()) <= 10
        assert one.holds in (True, False)
        json.dumps(finite(one.to_dict()), allow_nan=False)
        if one.table() or type(one).columns is not Result.columns:
            assert len({len(column) for column in one.to_dataframe().values()}) == 1
        if type(one).chart is not Result.chart:
            axes = Figure().add_subplot()
            assert one.plot(axes) is axes
            assert axes.get_xlabel()
            assert axes.get_ylabel()
            assert len(axes.lines) > 0
            assert axes.get_legend() is not None or len(axes.lines) == 1


def test_measure_and_noise__fingers_of_an_open_rig__are_the_load_or_refused(known: dict[str, object]):
    controller, rig = known["controller"], known["rig"]
    rig.finger("index").touch("finger")
    try:
        with pytest.raises(BadInput, match=r"index: finger, thumb: none, middle: none.*; it must be one load on all"):
            tt.measure_response(rig, controller, [30.0])
        response = tt.measure_response(rig, controller, [30.0, 100.0], channel=["index"]).responses[0]
    finally:
        rig.finger("index").touch(None)
    assert response.load == "finger"
    with pytest.raises(BadInput, match="no channel 'ring'; expected index, thumb, middle"):
        tt.measure_response(rig, controller, channel=["ring"])
    display = controller.display
    heavy = [replace(channel, loads=(Load("anvil", 400.0, 0.0, 0.0),)) for channel in display.channels]
    borne = replace(controller, display=replace(display, channels=tuple(heavy)))
    rig = tt.SimulatedRig(borne.display, seed=1)
    for channel in heavy:
        rig.finger(channel.name).touch("anvil")
    for verb in (tt.measure_response, tt.measure_noise):
        with pytest.raises(BadInput, match=r"unstable \(load 'anvil'\); expected a controller"):
            verb(rig, borne)


@pytest.mark.slow
def test_identify__chirp_through_a_loop__is_trusted_with_its_order_alone(known):
    rig, time_s = tt.SimulatedRig(known["controller"].display, seed=5), np.arange(20000) / 4000.0
    rig.load(known["controller"])
    chirp = 100.0 * np.sin(2.0 * np.pi * 0.5 * (600.0 ** (time_s / 5.0) - 1.0) * 5.0 / np.log(600.0))
    played = rig.play(np.repeat(chirp[:, None], len(rig.channels), axis=1))
    record = Record(rig.rate_hz, played.command_v[:, 0], played.position_v[:, 0])
    assert tt.identify(record).distrust
    assert not tt.identify(record, order=2).distrust


def test_nouns__each_that_a_user_holds__says_in_a_line_what_it_is(known: dict[str, object]):
    controller, rig = known["controller"], known["rig"]
    display = controller.display
    heard = tt.measure_response(rig, controller, [30.0, 100.0])
    spoken = tt.render("speech.wav", controller, "said.wav")
    nouns = [
        rig, rig.finger("index"), display, *display.channels, display.channels[0].threshold.curve, controller,
        controller.channels[0], display.channels[0].plant, heard.responses[0], rig.play(np.zeros((8, 3))),
        spoken.rendered, open_reference("said.wav"), tt.check(controller).objectives[0],
        tt.thresholds("lab.db").results,
    ]  # fmt: skip
    for noun in nouns:
        kind = type(noun).__name__.removesuffix("Result")
        assert re.match(rf"<{kind} \w", repr(noun)), repr(noun)
        assert len(repr(noun)) < 250
        assert "\n" not in repr(noun)
        assert " object at 0x" not in repr(noun)
    assert repr(tt.check(controller)).startswith("<Verdict ")
    assert all(f"{finger}: felt within" in repr(heard) for finger in ("index", "thumb", "middle"))
    assert "prefilter within 0." in repr(controller)
    assert " dB without friction" in repr(controller)  # friction may take 12 dB
    assert repr(rig) == "<SimulatedRig three-finger tactuator: index, thumb, middle at 4000 Hz, a controller runs>"


def test_result__without_table_or_figure_or_pandas_or_very_long__says_so(known, tmp_path, monkeypatch) -> None:
    with pytest.raises(tt.BadInput, match="is no table"):
        known["controller"].to_dataframe()
    with pytest.raises(tt.BadInput, match="nothing to draw"):
        tt.init(out=tmp_path / "mine.toml").plot()
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(tt.BadInput, match="pandas is not installed"):
        tt.read_curve("bolanowski-1988").to_dataframe()
    monkeypatch.setattr(Result, "headline", lambda result: {"x": "y" * 1000})
    assert len(repr(Result())) < 500


def test_record__motor_stronger_than_its_file__is_told_to_leave_the_travel(place: Path) -> None:
    text = Path("display.toml").read_text()
    Path("weak.toml").write_text(text.replace("num = [2875.0]", "num = [1000.0]"))
    rig = tt.SimulatedRig(tt.read_display("display.toml"), seed=1)
    planned = {"duration_s": 8.0, "travel_share": 0.8, "rig": rig}
    assert tt.record("weak.toml", **planned).beyond_travel
    assert not tt.record("display.toml", **planned).beyond_travel


def test_record__load_that_no_program_reaches__is_asked_of_the_person(place: Path, capsys) -> None:
    class Real(tt.SimulatedRig):
        has_finger_ports = False

    tt.record("display.toml", duration_s=4.0, load="finger", rig=Real(tt.read_display("display.toml"), seed=1))
    assert "put the load 'finger' on index by hand now" in capsys.readouterr().err


MINE = ThresholdCurve(
    "mine", [1.0, 30.0, 300.0], [20.0, 10.0, -10.0], "measured", "me", [1.0] * 3, Contact("index fingertip", 50.0)
)


def test_curves__with_one_of_ones_own__stand_beside_each_other(tmp_path: Path, run) -> None:
    mine = tmp_path / "mine.csv"
    write_curve(mine, MINE)
    last = run.json("curves", mine, "--figures", tmp_path / "drawn")["curves"][-1]
    assert (last["name"], last["contact"]["site"], last["contact"]["area_mm2"]) == ("mine", "index fingertip", 50.0)
    (table,) = curves([mine]).tables()  # a fingertip's is among them
    assert curves().next_step() == "measure your own: none of these was felt at a fingertip"
    assert curves([mine]).next_step() == ""
    assert table.rows[-1][:5] == ("mine", "measured", "1 to 300 Hz", "index fingertip", "50 mm²")
    assert table.rows[-1][5] == "not stated"
    assert [line.label for line in curves([mine]).chart().curves][-1] == "mine (index fingertip, measured)"
    assert (tmp_path / "drawn" / "curves.svg").is_file()
    listed = curves().curves
    assert tuple(curve.name for curve in listed) == curve_names()
    assert all(curve.contact.site for curve in listed)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: tt.design("x.toml", pole=8),
            r"design: got an unexpected keyword argument 'pole' \(did you mean 'poles",
        ),
        (lambda: tt.design(), "design: missing a required argument: 'display'"),
        (
            lambda: tt.open_rig("simulatd", tt.Display(4000.0, (tt.Channel("index", 0.2, 12.5, ([1.0], [1.0, 2.0])),))),
            r"no rig 'simulatd' \(did you mean 'simulated'\?\)",
        ),
        (lambda: coding_of("band"), r"no coding 'band' \(did you mean 'bands'\?\)"),
    ],
)
def test_call__misspelt__names_what_was_likely_meant(call, words: str) -> None:
    with pytest.raises((BadInput, TypeError), match=words):
        call()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        *((f"{of}({value})", f"frequency_hz is {got}; it must be numbers from 0 to 2000 Hz, half the sampling rate")
          for of in ("loop.sensitivity", "loop.open_response", "loop.plant.response")
          for value, got in (("None", "None"), ("-1", "-1"), ("[1.0, 2001.0]", "2001"), ("'10'", "'10'"))),
        *((f"{of}({value})", f"frequency_hz is {got}; it must be numbers of 0 Hz or more")
          for of in ("channel.threshold_voltage", "channel.plant.response", "channel.threshold.curve.displacement_mm")
          for value, got in (("None", "None"), ("[-1]", "-1"), ("np.inf", "inf"))),
        ("controller.write(None)", "ControllerResult.write: path is None; it must be the path of a file"),
        ("controller.loop(3)", "ControllerResult.loop: channel is 3; it must be a text"),
        ("rig.load('controller.json')", "controller is 'controller.json'; it must be a controller"),
        ("rig.drive(None)", "command is None; expected real numbers, (samples, 3)"),
    ],
)  # fmt: skip
def test_method__frequency_path_or_controller_amiss__is_refused_by_its_name(known, call: str, words: str) -> None:
    controller = known["controller"]
    channel = controller.display.channels[0]
    names = {**known, "channel": channel, "loop": controller.loop(channel.name)}
    with pytest.raises(tt.BadInput, match=f"^{re.escape(words)}"):
        eval(call, names)

"""The view Prefilter and curve: the fit is the design's own, and what is saved is what the shown command writes."""

import shlex

import numpy as np
import pytest

from tactuator.cli.main import main
from tactuator.console.prefilter_view import PrefilterFitted, PrefilterSaved
from tactuator.console.state import FILE, ConsoleState
from tactuator.errors import BadInput
from tactuator.io.controller import read_controller
from tactuator.signals.discretise import zero_order_hold
from tactuator.signals.loop import TwoDegreeLoop
from tests.console.pages import ONE, console_page, go, pressed, tab_to

FIT = {"display": FILE, "channel": "index"}


@pytest.fixture(scope="module")
def state(tmp_path_factory):
    path = tmp_path_factory.mktemp("prefilter") / "display.toml"
    path.write_text(ONE)
    return ConsoleState(path)


@pytest.fixture(scope="module")
def plain(state):
    return PrefilterFitted(**FIT).answer(state)


def moved(found, by_db):
    return [[hz, level + (by_db if hz == 20.0 else 0.0)] for hz, level in found["curve"]["points"]]


def test_fit__of_the_displays_own_curve__has_the_designs_error(state, plain):
    own = state.file_design(FILE, "index").report["prefilter"]
    assert plain["greatest_db"] == f"{own['max_error_db']:.2f}"
    assert max(np.abs(plain["error_db"])) == pytest.approx(own["max_error_db"], abs=0.05)


def test_fit__of_a_moved_point__follows_it_and_more_poles_follow_better(state, plain):
    assert 20.0 in [hz for hz, _ in plain["curve"]["points"]]
    points = moved(plain, -3.0)
    few, many = (PrefilterFitted(**FIT, points=points, poles=poles).answer(state) for poles in (4, 8))
    at = int(np.argmin(np.abs(np.array(few["frequency_hz"]) - 20.0)))
    assert few["wanted_db"][at] == pytest.approx(plain["wanted_db"][at] - 3.0, abs=0.3)
    assert many["poles"] == 8
    assert float(many["greatest_db"]) < float(few["greatest_db"])


def test_save__with_a_drawn_curve__is_what_the_shown_command_writes(state, plain, tmp_path, monkeypatch):
    asked = PrefilterSaved(display=FILE, points=moved(plain, 1.5), poles=5)
    found = asked.answer(state)
    (tmp_path / "curve.csv").write_text(found["curve"])
    monkeypatch.chdir(tmp_path)
    assert "--curve curve.csv --poles 5 --out personal.json" in found["command"]
    main(shlex.split(found["command"])[1:])
    assert (tmp_path / "personal.json").read_text() == found["text"]
    made = read_controller(tmp_path / "personal.json")
    channel, own = made.display.channels[0], made.channels[0]
    plant = zero_order_hold(channel.plant, made.rate_hz, made.display.delay_samples)
    loop = TwoDegreeLoop(own.prefilter(made.rate_hz), own.feedback(made.rate_hz), plant)
    given_um = 1e3 * np.abs(loop.position_response([20.0])) / channel.sensor_gain_v_per_mm
    wanted_db = dict(plain["curve"]["points"])[20.0] + 1.5
    assert 20.0 * np.log10(given_um)[0] == pytest.approx(wanted_db, abs=1.0)


def test_fit__of_a_curve_that_is_none__is_refused_in_words(state):
    for points, words in (
        ([[1.0, 0.0], [0.5, 0.0], [300.0, 0.0]], "out of order"),
        ([[0.4, 0.0], [0.4, 1.0], [300.0, 0.0]], "stands twice"),
        ([[10.0, 0.0], [20.0, 0.0], [30.0, 0.0]], "covers"),
    ):
        with pytest.raises(BadInput, match=words):
            PrefilterFitted(**FIT, points=points).answer(state)


@pytest.mark.slow
def test_prefilter__by_keyboard_alone__moves_a_point_back_and_adds_a_pole(browser, state):
    with console_page(browser, state.path(FILE)) as page:
        go(page, "prefilter", display=FILE)
        page.wait_for_selector("#error:has-text('Greatest error')")
        pressed(page, "#more", "#poles:has-text('5')")
        tab_to(page, "[aria-label='Threshold at 20 Hz']")
        before = float(page.evaluate("document.activeElement.getAttribute('aria-valuenow')"))
        for key, by in (("Shift+ArrowDown", -2.5), ("ArrowUp", -2.0), ("Control+z", -2.5)):
            page.keyboard.press(key)
            page.wait_for_selector(f"[aria-label='Threshold at 20 Hz'][aria-valuenow='{before + by:.1f}']")

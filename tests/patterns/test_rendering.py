"""A clip on a display: the level that is felt of its numbers, and what the display does not give."""

import json
import tomllib

import numpy as np
import pytest

from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.io.controller import write_controller
from tactuator.io.display import parse_display
from tactuator.io.shipped import display_template
from tactuator.patterns.clip import Breakpoints, Clip, Tap, Tone
from tactuator.patterns.rendering import MAPS, PatternMap, render_clip
from tactuator.synthesis.design import design_controller
from tests.patterns.test_clip import ADVANCED, HAPTIC


def steady(strength, pitch, taps=(), format="haptic", pitch_in_hz=False, duration_s=1.0):
    courses = [Breakpoints(np.zeros(1), np.array([float(value)])) for value in (strength, pitch)]
    return Clip("steady", format, duration_s, (Tone(0.0, duration_s, *courses),), tuple(taps), pitch_in_hz)


@pytest.mark.parametrize(
    ("clip", "hertz", "level_db_sl"),
    [
        (steady(1.0, 0.5), 127.5, 30.0),
        (steady(0.1, 0.0), 55.0, 10.0),
        (steady(0.5, 1.0, format="ahap"), 300.0, 30.0 - 6.0206),
        (steady(0.5, 0.0, format="android-basic"), 65.0, 15.0),
        (steady(1.0, 80.0, format="android-advanced", pitch_in_hz=True), 80.0, 30.0),
    ],
)
def test_render__steady_tone__has_the_level_and_the_frequency_that_the_map_says(
    controller, clip, hertz, level_db_sl
) -> None:
    mapping = PatternMap(**vars(MAPS[clip.format]) | {"full_db_sl": 30.0})
    rendered = render_clip(clip, controller, mapping)
    count = round(0.5 * controller.rate_hz)
    middle = rendered.reference[count // 2 : count // 2 + count]
    turn = np.exp(-2j * np.pi * hertz / controller.rate_hz * np.arange(count)) * np.hanning(count)
    amplitudes = np.abs(turn @ middle) * 2.0 / np.hanning(count).sum()
    np.testing.assert_allclose(20.0 * np.log10(amplitudes), level_db_sl, atol=0.02)
    assert (rendered.loss.shortfall_db_sl, rendered.loss.frequency_shift_jnd) == (0.0, 0.0)


def test_render__tap__rises_above_a_tone_that_is_weaker_beneath_it(controller) -> None:
    loss = render_clip(steady(0.5, 0.5, [Tap(0.4, 1.0, 0.5)]), controller).loss
    asked, delivered = loss.emphasis_rise_db
    assert asked == delivered
    assert 6.0 < asked < 15.0  # 1 and a quarter against a quarter, however the two meet


def test_render__pitch_beyond_the_band__is_moved_and_told_in_differences_that_are_noticed(controller) -> None:
    loss = render_clip(steady(0.5, 600.0, format="android-advanced", pitch_in_hz=True), controller).loss
    assert loss.frequency_shift_jnd == pytest.approx(np.log(2.0) / np.log(1.13))


@pytest.fixture(scope="module")
def lra():
    return design_controller(parse_display(tomllib.loads(display_template("lra"))))


def test_render__more_than_a_resonant_actuator_gives__tells_how_far_it_falls_short(lra) -> None:
    loud = render_clip(steady(1.0, 0.0), lra, PatternMap(full_db_sl=50.0))
    quiet = render_clip(steady(1.0, 0.0), lra, PatternMap(full_db_sl=5.0))
    middle = np.abs(loud.reference[len(loud.reference) // 3 : len(loud.reference) // 2]).max()
    assert quiet.loss.shortfall_db_sl == 0.0
    assert loud.loss.mean_shortfall_db == pytest.approx(50.0 - 20.0 * np.log10(middle), abs=0.5)
    assert loud.loss.shortfall_db_sl > loud.loss.mean_shortfall_db > 20.0  # a beginning needs more than its tone
    assert loud.loss.clipped_s > 0.9


def test_render__level_above_comfort__is_refused(controller) -> None:
    with pytest.raises(BadInput):
        render_clip(steady(1.0, 0.5), controller, PatternMap(full_db_sl=60.0))


def test_render_verb__clip__writes_a_reference_and_ends_with_1_where_more_is_lost_than_allowed(
    tmp_path, lra, capsys
) -> None:
    clip, at = tmp_path / "knock.haptic", tmp_path / "lra.json"
    clip.write_text(json.dumps(HAPTIC))
    write_controller(at, lra)
    asked = ["render", str(clip), "--controller", str(at), "--json"]
    assert main([*asked, "--out", str(tmp_path / "a.wav"), "--level", "5"]) == 0
    loss = json.loads(capsys.readouterr().out)["loss"]
    assert {"shortfall_db_sl", "clipped_s", "frequency_shift_jnd"} <= set(loss)
    assert main([*asked, "--out", str(tmp_path / "b.wav"), "--level", "54", "--figures", str(tmp_path / "f")]) == 1
    assert json.loads(capsys.readouterr().out)["loss"]["shortfall_db_sl"] > 3.0
    assert (tmp_path / "f" / "knock.svg").exists()
    assert main([*asked, "--out", str(tmp_path / "c.wav"), "--coding", "bands"]) == 2


def test_pattern_verb__clip__says_what_it_is_or_the_rule_that_it_breaks(tmp_path, capsys) -> None:
    clip = tmp_path / "a.xml"
    clip.write_text(ADVANCED)
    # valid, but a device need not play an envelope that does not end at 0: the answer is told, and does not hold
    assert main(["pattern", str(clip), "--json", "--figures", str(tmp_path / "f")]) == 1
    told = json.loads(capsys.readouterr().out)
    assert (told["format"], told["valid"], told["duration_s"]) == ("android-advanced", True, 0.05)
    assert told["unsure"] == ["an end at 0.5; sure: an end at 0"]
    ending = '<control-point amplitude="0" frequencyHz="80" durationMs="50" /></w'
    clip.write_text(ADVANCED.replace("</w", ending))
    assert main(["pattern", str(clip)]) == 0
    clip.write_text(ADVANCED.replace("0.5", "5"))
    assert main(["pattern", str(clip)]) == 2
    assert "amplitude is 5; allowed: 0 to 1" in capsys.readouterr().err

"""Crosstalk of fingers one of which moves another by a known share, against the loop's own response."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tactuator as tt
from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.io.controller import write_controller
from tactuator.model.description import Converter
from tactuator.rig.simulated import ComputedRig, SimulatedRig
from tactuator.runtime.simulation import Simulation
from tests.measure.loops import QUIET, QUIETER, loop_response
from tests.runtime.paper_display import changed, channel, controller, display

HERTZ = (5.0, 30.0, 100.0, 250.0)
MADE = controller(display(*(channel(name, environment=QUIET) for name in ("index", "thumb", "middle"))))


class Leaking(Simulation):
    """The simulated display, whose thumb moves by a share of the index finger: as felt, or as its sensor reads it."""

    def __init__(self, made, share, signal):
        super().__init__(made.display, seed=1)
        self.share, self.signal = share, signal

    def play(self, reference, force_v=None):
        block = super().play(reference, force_v)
        index, thumb = (each.sensor_gain_v_per_mm for each in self.display.channels[:2])
        moved = getattr(block, self.signal).copy()
        moved[:, 1] += self.share * moved[:, 0] * (thumb / index if self.signal == "position_v" else 1.0)
        return replace(block, **{self.signal: moved})


class WithoutPorts(ComputedRig):
    """The rig as if its display were real: the sensors alone say what moves."""

    has_finger_ports = False


def leaking(share=0.1, made=MADE, signal="displacement_mm"):
    of = ComputedRig if signal == "displacement_mm" else WithoutPorts
    return of(made.display, Leaking(made, share, signal))


def measured(rig, hertz=HERTZ, level_db_sl=30.0, made=MADE, **asked):
    return tt.measure_crosstalk(rig, made, hertz, level_db_sl, **asked)


def leaked_db_sl(share, hertz, level_db_sl):
    """Level on the thumb of a share of the index finger's motion: the loop's response at the curve's threshold."""
    answer, _ = loop_response(QUIETER, np.array([hertz]))
    moved_mm = 10.0 ** (level_db_sl / 20.0) * float(abs(answer[0])) / MADE.display.channels[0].sensor_gain_v_per_mm
    threshold_um = 10.0 ** (float(MADE.display.channels[1].threshold.curve.level_db_re_1um_at(hertz)) / 20.0)
    return 20.0 * np.log10(share * 1e3 * moved_mm / threshold_um)


@pytest.mark.parametrize("signal", ["displacement_mm", "position_v"])
def test_crosstalk__a_tenth_of_the_motion__is_felt_20_db_below_on_that_finger_alone(signal) -> None:
    found = measured(leaking(signal=signal), level_db_sl=45.0, confidence_db=0.05, channel=["index"])
    assert [(row.driven, row.frequency_hz) for row in found.rows] == [("index", hertz) for hertz in HERTZ]
    for row in found.rows:
        assert row.levels["index"].level_db_sl == pytest.approx(leaked_db_sl(1.0, row.frequency_hz, 45.0), abs=0.1)
        assert row.others["thumb"].level_db_sl == pytest.approx(leaked_db_sl(0.1, row.frequency_hz, 45.0), abs=0.1)
        assert row.others["middle"].level_db_sl is None
        assert row.others["middle"].below_db_sl < 0.0
    assert not found.holds


@pytest.mark.parametrize("signal", ["displacement_mm", "position_v"])
def test_crosstalk__leak_below_the_noise__is_told_by_what_it_is_below(signal) -> None:
    found = measured(leaking(1e-5, signal=signal), channel=["index"])
    assert found.holds
    for row in found.rows:
        assert row.levels["thumb"].level_db_sl is None
        assert leaked_db_sl(1e-5, row.frequency_hz, 30.0) < row.levels["thumb"].below_db_sl < 0.0


def test_crosstalk__motion_within_a_step_of_a_sensor_without_noise__is_not_excluded() -> None:
    coarse = {"environment": replace(QUIET, noise_v_rms=0.0), "converter": Converter(bits=10)}
    made = controller(display(*(channel(name, **coarse) for name in ("index", "thumb"))))
    (row,) = measured(leaking(1e-3, made, "position_v"), [30.0], made=made, channel=["index"]).rows
    assert row.levels["thumb"].level_db_sl is None
    assert row.levels["thumb"].below_db_sl > leaked_db_sl(1e-3, 30.0, 30.0)


def test_crosstalk__display_without_any_noise__is_below_what_a_gauge_reads() -> None:
    still = changed(MADE, feedback_sos=None)
    for row in measured(SimulatedRig(still.display), [30.0], made=still).rows:
        assert all(-100.0 <= level.below_db_sl < -90.0 for level in row.others.values())


def test_crosstalk__noise_above_threshold__is_averaged_until_no_more_is_left_open() -> None:
    noisy = controller(
        display(*(channel(name, environment=replace(QUIET, noise_v_rms=2e-3)) for name in ("index", "thumb")))
    )
    quick, patient = (
        measured(leaking(0.0, noisy, "position_v"), [250.0], made=noisy, longest_s=longest_s)
        for longest_s in (2.0, 200.0)
    )
    assert (quick.holds, patient.holds) == (False, True)
    assert quick.notices() == ["noise hides levels above threshold: a longer `longest_s`"]
    assert not patient.notices()


def test_crosstalk__what_cannot_be_measured__is_refused() -> None:
    alone = controller(display(channel(environment=QUIET)))
    deaf = leaking(signal="position_v")
    deaf.without_sensor = ("thumb", "middle")
    for rig, asked, words in (
        (leaking(), {"channel": ["ring"]}, "no channel 'ring'"),
        (leaking(), {"level_db_sl": 60.0}, "60 dB SL"),
        (ComputedRig(alone.display, Simulation(alone.display)), {"made": alone}, "'index' is the only one"),
        (deaf, {"channel": ["index"]}, "'thumb' has no sensor"),
    ):
        with pytest.raises(BadInput, match=words):
            measured(rig, **asked)


def test_measure_crosstalk__of_the_command_line__has_a_row_for_each_frequency(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_controller(tmp_path / "c.json", MADE)
    asked = ["measure", "crosstalk", "--controller", str(tmp_path / "c.json"), "--frequency-hz", "10,100"]
    assert main([*asked, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    names = ("index", "thumb", "middle")
    assert [(row["driven"], row["frequency_hz"]) for row in rows] == [
        (name, hz) for name in names for hz in (10.0, 100.0)
    ]
    assert all(set(row["levels"]) == set(names) for row in rows)
    assert main([*asked, "--channel", "thumb", "--full"]) == 0
    assert "below -" in capsys.readouterr().out


def test_crosstalk__level_not_stated__is_what_stays_within_the_limits_and_a_stated_one_is_kept(capsys) -> None:
    small = [channel(name, environment=QUIET, travel_mm=0.2) for name in ("index", "thumb")]
    made = controller(display(*small))
    found = tt.measure_crosstalk(SimulatedRig(made.display, 1), made, [2.0, 30.0], channel=["index"], longest_s=1.0)
    assert found.level_db_sl < 30.0
    assert not any(row.saturated for row in found.rows)
    words = f"level {found.level_db_sl:g} dB SL: 30 would pass the comfort limit, the range or the travel"
    assert words in capsys.readouterr().err
    stated = tt.measure_crosstalk(SimulatedRig(made.display, 1), made, [2.0], 30.0, channel=["index"], longest_s=1.0)
    assert stated.level_db_sl == 30.0

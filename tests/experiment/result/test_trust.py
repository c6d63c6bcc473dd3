"""What a clinic may trust: who is left out of a group curve, what is clipped, what is called simulated."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.lines import CARETUPBASE

from tactuator.errors import BadInput
from tactuator.experiment.procedure.curve_prior import CurvePrior
from tactuator.experiment.procedure.whole_curve import WholeCurve, WholeCurveRule
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.result.confusion import threshold_table
from tactuator.experiment.result.played import delivered_level
from tactuator.experiment.result.store_results import (
    circumstances,
    group_curve,
    person_thresholds,
    psychometric_trials,
    store_results,
)
from tactuator.experiment.result.thresholds import DOUBTFUL, MeasuredThreshold, replayed, thresholds
from tactuator.experiment.session.task import SystemClock
from tactuator.experiment.simulated.sitting import run_study, simulated_observers, with_truths
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import StoredRun, detection_runs
from tactuator.experiment.words import shipped_words
from tactuator.perception import curve as library
from tactuator.perception.curve import RelativeCurve
from tactuator.report.felt import psychometric_plate, thresholds_plate
from tactuator.verbs.result import plain
from tests.experiment.session.apparatuses import apparatus

LIBRARY = library.curve("bolanowski-1988")
DEAF = RelativeCurve(np.array([10.0]), np.array([90.0]), "feels nothing")
TEXT = """
[study]
name = "trust"
seed = 3
[procedure]
kind = "up-down"
start_db_sl = 20
steps_db = [4, 4, 4, 2]
reversals = 9
averaged = 6
trial_limit = 60
[conditions]
fingers = ["index"]
frequencies_hz = [8, 30, 200]
[catch]
loud_share = 0.2
blank_share = 0.1
[timing]
stimulus_s = 0.25
ramp_s = 0.05
gap_s = 0.01
lead_s = 0.01
feedback_s = 0.0
[session]
practice_trials = 0
[[subject]]
code = "S1"
[[subject]]
code = "S2"
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    store = Store(tmp_path_factory.mktemp("trust") / "lab.db")
    drawn = simulated_observers(LIBRARY, 2, seed=5)
    observers = with_truths(drawn, ("S1", "S2"), LIBRARY, {"S2": DEAF}, {"S1": 0.0})
    run_study(store, parse_protocol(TEXT), TEXT, apparatus(), observers, SystemClock(), "finger")
    yield store, observers
    store.close()


def test_thresholds__somebody_who_feels_nothing__are_censored_and_stay_in_the_curve(study) -> None:
    store, _ = study
    found = thresholds(detection_runs(store))
    deaf = [one for one in found if one.subject == "S2"]
    assert len(deaf) == 3
    for one in deaf:
        assert {"chance", "out-of-range"} <= set(one.flags)
        assert one.bound == ">="
        assert one.refit_high_db_sl == one.level_high_db_re_1um == np.inf
        assert np.isnan(one.refit_sd_db)
    group = group_curve(found, LIBRARY, (0.4, 300.0))
    assert group.subjects == (0, 2, 2, 2, 0)
    assert group.censored == (0, 1, 1, 1, 0)
    assert group.bound == (">=",) * 5  # one person measured and one beyond: the mean is known from one side
    alone = group_curve([one for one in found if one.subject == "S1"], LIBRARY, (0.4, 300.0))
    assert np.all(group.curve.level_db_re_1um > alone.curve.level_db_re_1um + 5.0)
    assert set(circumstances(group, detection_runs(store))["bound"]) == {">="}


@pytest.mark.parametrize("leave_out", [["flagged"], ["S2"]])
def test_group_curve__somebody_is_left_out__by_the_experimenter_alone(study, leave_out) -> None:
    found = thresholds(detection_runs(study[0]))
    alone = group_curve([one for one in found if one.subject == "S1"], LIBRARY, (0.4, 300.0), leave_out[:0])
    group = group_curve(found, LIBRARY, (0.4, 300.0), leave_out)
    assert group.curve.level_db_re_1um == pytest.approx(alone.curve.level_db_re_1um)
    assert {one.subject for one in group.left_out} == {"S2"}
    assert group.subjects == (0, 1, 1, 1, 0)
    with pytest.raises(BadInput, match="3 thresholds left out"):
        group_curve([one for one in found if one.subject == "S2"], LIBRARY, (0.4, 300.0), leave_out)
    with pytest.raises(BadInput, match="S9; allowed: flagged, S1, S2"):
        group_curve(found, LIBRARY, (0.4, 300.0), ["S9"])


def test_store_results__somebody_is_flagged__both_curves_are_told(study) -> None:
    store, _ = study
    for leave_out, subjects, which in (([], (2, 1), "without"), (["flagged"], (1, 2), "with")):
        told = store_results(store.path, leave_out=leave_out)
        document = json.loads(json.dumps(plain(told.document()), allow_nan=False))
        counts = [max(point["subjects"] for point in document[name]) for name in ("curve", "curve_beside")]
        assert tuple(counts) == subjects
        assert told.beside_is == f"{which} those flagged"
        assert {each["subject"] for each in document["doubtful"]} >= {"S2"}
        deaf = [one for one in document["thresholds"] if one["subject"] == "S2"]
        assert {(one["bound"], one["refit_high_db_sl"]) for one in deaf} == {(">=", None)}


def test_thresholds__good_subject__unflagged_and_near_the_truth(study) -> None:
    store, observers = study
    for one in thresholds(detection_runs(store)):
        if one.subject == "S1":
            truth = float(observers[0].curve.level_db_re_1um_at(one.frequency_hz))
            assert one.level_db_re_1um == pytest.approx(truth, abs=4.0 * one.sd_db + 0.5)
            assert not {"chance", "out-of-range", "mains", "attention"} & set(one.flags)
            assert one.level_low_db_re_1um < one.level_db_re_1um < one.level_high_db_re_1um
            assert one.point == pytest.approx(0.5 ** (1 / 3), abs=1e-4)


def test_thresholds__on_a_simulated_rig__are_called_simulated(study) -> None:
    store, _ = study
    found = thresholds(detection_runs(store))
    assert all(one.simulated for one in found)
    assert any("simulated" in note for note in threshold_table(found, shipped_words("en")).notes)
    assert group_curve(found, LIBRARY, (0.4, 300.0)).curve.provenance == "simulated"
    plates = psychometric_trials(detection_runs(store), found)
    plate = psychometric_plate("S1", plates["S1"])
    assert "simulated" in plate.caption
    assert set(plate.table["simulated"]) == {"simulated"}
    for drawn in (plate, thresholds_plate(person_thresholds(found), LIBRARY, None)):
        assert "simulated: nobody felt this" in drawn.svg()
        assert drawn.figure.get_suptitle() == "simulated: nobody felt this"
        assert ",simulated\n" in drawn.csv()
    felt = thresholds_plate(person_thresholds([replace(one, simulated=False) for one in found]), LIBRARY, None)
    assert "simulated" not in felt.svg() + felt.csv()
    assert sum(plate.table["trials"]) == sum(int(one.count.sum()) for one in plates["S1"])


def test_figure__doubtful_and_censored_thresholds__are_crossed_have_arrows_and_are_told(study) -> None:
    found = thresholds(detection_runs(study[0]))
    people = person_thresholds(found)
    assert [one.name for one in people] == ["S1", "S2"]
    assert people[1].flagged.all()
    plate = thresholds_plate(people, LIBRARY, None)
    count = sum(bool(DOUBTFUL & set(one.flags)) for one in found)
    assert f"Crossed: {count} thresholds" in plate.caption
    beyond = sum(bool(one.bound) for one in found)
    assert f"Arrows: {beyond} that lie beyond" in plate.caption
    arrows = [line for line in plate.figure.axes[0].lines if line.get_marker() == CARETUPBASE]
    drawn = np.concatenate([line.get_xydata() for line in arrows])
    assert sum(bool(bound) for bound in plate.table["bound"]) == beyond == len(drawn) == 3
    assert np.all(drawn[:, 1] < plate.figure.axes[0].get_ylim()[1])
    assert sum(plate.table["flagged"]) == count
    crosses = [line for line in plate.figure.axes[0].lines if line.get_marker() == "x"]
    assert sum(line.get_xdata().size for line in crosses) == count
    assert "flagged" not in thresholds_plate([replace(one, flagged=None) for one in people], LIBRARY, None).table


def test_group_curve__same_code_in_two_studies__is_two_people(study) -> None:
    found = sorted(thresholds(detection_runs(study[0])), key=lambda one: one.frequency_hz)
    felt = [replace(one, simulated=False) for one in found if one.subject == "S1"]
    assert group_curve(felt, LIBRARY, (0.4, 300.0)).curve.provenance == "measured"
    other = [replace(one, study_number=2, level_db_re_1um=one.level_db_re_1um + 8.0) for one in felt]
    both = group_curve([*felt, *felt, *other], LIBRARY, (0.4, 300.0))  # S1 of study 1 came twice
    assert both.subjects == (0, 2, 2, 2, 0)
    assert both.curve.level_db_re_1um[1:4] == pytest.approx([one.level_db_re_1um + 4.0 for one in felt])
    assert [one.name for one in person_thresholds([*felt, *other])] == ["S1-1", "S1-2"]
    assert set(psychometric_trials(detection_runs(study[0]), felt)) == {"S1"}


def test_with_truths__stranger_or_impossible_lapse__is_refused() -> None:
    drawn = simulated_observers(LIBRARY, 1, seed=5)
    with pytest.raises(BadInput, match="S9"):
        with_truths(drawn, ("S1",), LIBRARY, {"S9": DEAF}, {})
    with pytest.raises(BadInput, match="lapse"):
        with_truths(drawn, ("S1",), LIBRARY, {}, {"S1": 0.5})


@pytest.mark.parametrize(("frequency_hz", "limit_db"), [(298.0, 0.2), (10.0, 1.0)])
def test_delivered__display_a_decibel_low_in_noise__is_found_with_its_error(frequency_hz, limit_db) -> None:
    """At 298 Hz and -4 dB SL by the loud trials of the run; below 25 Hz by those near threshold alone."""
    errors, stated = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        level = np.concatenate([[20.0] * 3, [16.0] * 3, [12.0] * 3, rng.integers(-7, 0, 60).astype(float)])
        hum = 0.3 * (rng.standard_normal((2, 2 * level.size)) @ np.diag(np.ones(2 * level.size)))
        blank = 20 * np.log10(np.hypot(*hum[:, : level.size]))
        gain = 10 ** ((level - 1.0) / 20)
        seen = 20 * np.log10(np.hypot(gain + hum[0, level.size :], hum[1, level.size :]))
        commanded = np.concatenate([np.full(level.size, np.nan), level])
        found = delivered_level(commanded, np.concatenate([blank, seen]), frequency_hz, -4.0)
        errors.append(found.offset_db + 1.0)
        stated.append(found.sd_db)
    assert float(np.std(errors)) <= limit_db
    assert float(np.mean(stated)) == pytest.approx(float(np.std(errors)), rel=0.5)
    assert abs(float(np.mean(errors))) <= 0.1


def test_delivered__nothing_near_or_only_noise__is_unknown() -> None:
    assert np.isnan(delivered_level(np.array([np.nan, 30.0]), np.array([0.0, 30.0]), 10.0, 0.0).offset_db)
    assert np.isnan(delivered_level(np.array([np.nan]), np.array([0.0]), 100.0, 0.0).offset_db)


@pytest.mark.parametrize("mains_hz", [60.0, 50.0, 0.0])
def test_replayed__whole_curve_at_a_display_with_other_mains__has_the_frequencies_that_were_played(mains_hz) -> None:
    head, tail = TEXT.split("[procedure]")[0], TEXT[TEXT.index("[conditions]") :]
    protocol = parse_protocol(
        f'{head}[procedure]\nkind = "curve"\n{tail}'.replace("frequencies_hz = [8, 30, 200]\n", "")
    )
    prior = WholeCurveRule(prior=CurvePrior(band_hz=(0.4, 300.0), mains_hz=mains_hz, clearance_hz=4.0)).prior
    about = SimpleNamespace(band_low_hz=0.4, band_high_hz=300.0)
    hertz = prior.frequency_hz
    run = StoredRun(None, about, protocol, hertz, 0.0 * hertz, 0.0 * hertz, hertz > 0.0, None)  # type: ignore[arg-type]
    procedure = replayed(run)
    assert isinstance(procedure, WholeCurve)
    assert procedure.rule.prior.frequency_hz == pytest.approx(hertz)


def test_threshold__is_a_named_point(study) -> None:
    one = thresholds(detection_runs(study[0]))[0]
    assert isinstance(one, MeasuredThreshold)
    assert any("79.4 % correct" in note for note in threshold_table([one], shipped_words("en")).notes)

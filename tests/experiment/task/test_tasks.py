"""Tasks as state machines; and what matches tell, against people whose function is written here."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Playable
from tactuator.experiment.task.estimate import CANNOT_TELL, estimate
from tactuator.experiment.task.intensity import FREE, FUNCTIONS
from tactuator.experiment.task.magnitude_estimation import MagnitudeEstimation, magnitudes
from tactuator.experiment.task.matches import Candidates, ContourSetting, Matches, fit, most_telling
from tactuator.experiment.task.matching import Matching
from tactuator.experiment.task.task import Answered, AnsweredRun, Place, parse_task
from tactuator.experiment.trial import Timing, number_of
from tactuator.experiment.words import shipped_words
from tactuator.perception.curve import curve
from tests.griffin import distance_db

PLACE = Place(Playable(), Timing())
TASKS = {
    "contour": {"kind": "matching", "finger": "index", "trials": 20},
    "pairs": {"kind": "matching", "finger": "index", "method": "pairs", "comparisons_hz": [40.0], "reversals": 2},
    "estimation": {"kind": "magnitude-estimation", "finger": "index", "frequencies_hz": [40.0, 250.0]},
    "amplitude": {"kind": "discrimination", "of": "amplitude", "fingers": ["index"], "frequencies_hz": [40.0]},
    "frequency": {"kind": "discrimination", "of": "frequency", "fingers": ["index"], "frequencies_hz": [40.0]},
    "gap": {"kind": "discrimination", "of": "gap", "fingers": ["index"], "frequencies_hz": [140.0]},
    "order": {"kind": "discrimination", "of": "order", "fingers": ["index", "thumb"], "frequencies_hz": [140.0]},
}


def answered(keys, answer, seed: tuple[int, ...]) -> AnsweredRun:
    """A run answered by a function of the trial, the levels of its tones, and a generator."""
    run, rng, trials = keys.begin(0, PLACE, seed), np.random.default_rng(seed), []
    while (trial := run.trial()) is not None:
        response = answer(trial, [tones[0].level_db_sl for tones in trial.tones], rng)
        run.record(response)
        trials.append(Answered.of(trial, response))
    return AnsweredRun("S", "index", trials[0].tones[0].frequency_hz, tuple(trials), True)


def played(document: dict, seed: int = 1, most: int = 2000):
    run, rng, trials = parse_task(document).begin(0, PLACE, (seed,)), np.random.default_rng(seed), []
    while (trial := run.trial()) is not None and len(trials) < most:
        assert run.draw(len(trials)) == trial
        response = "7.5" if not trial.responses else trial.responses[int(rng.integers(len(trial.responses)))]
        run.record(response)
        trials.append((trial, response))
    assert run.trial() is None
    return trials, run


@pytest.mark.parametrize("name", TASKS)
def test_task__any_answers__ends_and_replays_in_every_language(name: str) -> None:
    trials, run = played(TASKS[name])
    assert run.progress == pytest.approx(1.0)
    again, _ = played(TASKS[name])
    assert [trial for trial, _ in trials] == [trial for trial, _ in again]
    assert all(len(trial.stimuli) == len(trial.tones) for trial, _ in trials)
    keys = parse_task(TASKS[name])
    for words in map(shipped_words, ("en", "de", "fr")):
        asked = keys.asked(words)
        assert asked.prompt
        assert all(plan.what and plan.trials > 0 for plan in keys.plans(words))
        assert len({key for _, of in asked.responses for key in of}) == len(asked.responses)


@pytest.mark.parametrize("name", ["contour", "pairs"])
def test_matching__order_and_standard__are_balanced_and_levels_comfortable(name: str) -> None:
    keys = parse_task(TASKS[name])
    trials = [trial for trial, _ in played(TASKS[name])[0]]
    rows = [keys.row([tones[0] for tones in trial.tones], True) for trial in trials]
    second, swapped = [row[3] for row in rows], [row[4] for row in rows]
    assert np.mean(second) == pytest.approx(0.5, abs=0.1)
    assert 0.3 < np.mean(swapped) < 0.7
    assert all(tone.level_db_sl <= 55.0 for trial in trials for tones in trial.tones for tone in tones)
    assert all(trial.correct == str(1 + row[3]) for trial, row in zip(trials, rows, strict=True))
    placed = [trial.placement.frequency_hz for trial in trials]
    assert placed == [100.0 if row[4] else row[0] for row in rows]
    assert name == "pairs" or [sum(row[2] == level for row in rows) for level in keys.levels_db_sl] == [4] * 5


def test_pairs__a_listener_without_noise__is_found_where_the_tones_are_equal() -> None:
    keys = Matching(finger="index", method="pairs", comparisons_hz=(40.0,), levels_db_sl=(20.0, 30.0))

    def stronger(trial, felt, rng) -> str:
        at_40_hz = [tones[0].frequency_hz == 40.0 for tones in trial.tones]
        return trial.responses[int(np.argmax(felt - 5.0 * np.array(at_40_hz) + rng.normal(size=2)))]

    run = answered(keys, stronger, (3, 4))
    found = keys.equality(run)
    assert found.above_db.value == pytest.approx(5.0, abs=0.7)
    assert found.above_db.low < 5.0 < found.above_db.high
    assert abs(found.order_db.value) < 0.6
    assert keys.results((run,), shipped_words("de"))[0].rows


def test_discrimination__the_changed_interval__differs_by_what_was_placed() -> None:
    for name in ("amplitude", "frequency", "gap", "order"):
        for trial, _ in played(TASKS[name])[0][:40]:
            difference = 10.0 ** (trial.placement.level_db_sl / 20.0)
            if name == "order":
                ((one, other),) = trial.tones
                assert other.onset_s - one.onset_s == pytest.approx(1e-3 * difference)
                assert trial.correct == one.finger
                continue
            target = trial.tones[trial.responses.index(trial.correct)]
            base = trial.tones[trial.responses.index(trial.correct) - 1][0]
            if name == "amplitude":
                assert target[0].level_db_sl - base.level_db_sl == pytest.approx(min(difference, 35.0))
            elif name == "frequency":
                assert target[0].frequency_hz == pytest.approx(min(40.0 * (1.0 + difference / 100.0), 300.0))
            else:
                silent = target[1].onset_s - target[0].duration_s
                assert silent == pytest.approx(min(1e-3 * difference, 0.8 * base.duration_s))
                assert target[1].onset_s + target[1].duration_s == pytest.approx(base.duration_s)


def test_magnitudes__a_power_function_in_any_modulus__gives_its_exponent() -> None:
    keys = MagnitudeEstimation(finger="index", frequencies_hz=(40.0, 250.0), repeats=2)

    def estimated(trial, felt, rng, modulus) -> str:
        exponent = {40.0: 0.9, 250.0: 0.45}[trial.tones[0][0].frequency_hz]
        return f"{modulus * 10.0 ** (exponent * felt[0] / 20.0) * np.exp(rng.normal(0.0, 0.05)):.4g}"

    people = [partial(estimated, modulus=modulus) for modulus in (0.1, 300.0)]
    runs = [replace(answered(keys, each, (at, 2)), subject=f"S{at}") for at, each in enumerate(people)]
    low, high = magnitudes(runs)
    assert (low.exponent.value, high.exponent.value) == pytest.approx((0.9, 0.45), abs=0.03)
    assert low.exponent.low < 0.9 < low.exponent.high
    assert low.mean[-1] / low.mean[0] == pytest.approx(10.0 ** (0.9 * 2.0), rel=0.15)
    chart = keys.chart(runs, shipped_words("en"))
    marks, line = chart.curves[:2]
    assert chart.log_y
    assert marks.label.startswith("40 Hz: exponent 0.")
    slope = np.polyfit(line.x * np.log(10.0) / 20.0, np.log(line.y), 1)[0]
    assert (slope, marks.y[0]) == pytest.approx((low.exponent.value, low.mean[0]))
    below, above = marks.half
    assert np.all((below > 0.0) & (above > below))


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ({"kind": "guessing"}, "guessing.*discrimination, magnitude-estimation, matching"),
        ({"kind": "matching"}, "finger: missing|missing"),
        ({"kind": "matching", "finger": "index", "method": "pairs"}, "comparisons_hz"),
        ({"kind": "matching", "finger": "index", "comparisons_hz": [40.0]}, "none: the method chooses"),
        ({"kind": "matching", "finger": "index", "frequency_hz": 400.0}, "frequency_hz"),
        (TASKS["pairs"] | {"comparisons_hz": [100.0]}, "other frequencies than the standard's"),
        ({"kind": "discrimination", "of": "order", "fingers": ["index"], "frequencies_hz": [40.0]}, "two"),
        (TASKS["gap"] | {"rove_db": 3.0}, "rove_db"),
    ],
)
def test_parse_task__what_cannot_be__is_refused(document: dict, message: str) -> None:
    with pytest.raises(BadInput, match=message):
        parse_task(document)
    assert number_of("2,5") == 2.5
    for response in ("1,234", "12,500"):
        with pytest.raises(BadInput, match="thousands"):
            number_of(response)
    for response in ("0", "-1", "inf", "nan", "strong", ""):
        with pytest.raises(BadInput, match="a number above 0"):
            number_of(response)


SETTING = ContourSetting()
KNOWN = replace(SETTING, curve=curve("bolanowski-1988"))
AMONG = Candidates(np.geomspace(10.0, 300.0, 10), np.array([10.0, 20.0, 30.0, 40.0, 50.0]))


def shifted(per_octave_db: float, growth: float):
    """A person for whom f is as strong as 100 Hz where it lies so far off in proportion to the octaves between."""

    def level(hertz, level_db_sl):
        octaves = np.log2(np.asarray(hertz) / 100.0)
        return np.asarray(level_db_sl) * (1.0 + growth * octaves) + per_octave_db * octaves

    return level


def matched(level, trials: int, seed: int, order_db: float = 0.0, standard_db: float = 0.0, sd: float = 2.0) -> Matches:
    """Matches at random places, with a normal scatter and these biases."""
    rng = np.random.default_rng(seed)
    hertz, reference = rng.choice(AMONG.frequency_hz, trials), rng.choice(AMONG.reference_db_sl, trials)
    second, swapped = rng.random(trials) < 0.5, rng.random(trials) < 0.5
    felt = np.where(second, order_db, -order_db) + np.where(swapped, standard_db, -standard_db)
    comparison = level(hertz, reference) + rng.uniform(-5.0, 5.0, trials)
    stronger = comparison + felt + rng.normal(0.0, sd, trials) > level(hertz, reference)
    return Matches(hertz, comparison, reference, second, swapped, stronger)


@pytest.mark.parametrize("level", [shifted(0.0, 0.0), shifted(3.0, 0.0), shifted(0.0, -0.12)])
def test_estimate__six_hundred_random_matches__finds_contours_within_a_db(level) -> None:
    found = estimate(matched(level, 600, 3), SETTING)
    hertz, levels = np.geomspace(10.0, 300.0, 15), np.array([10.0, 30.0, 50.0])
    mean, low, high = found.contours(hertz, levels)
    assert np.all(np.diff(mean, axis=0) > 0.0)
    assert found.contours(np.array([100.0]), levels)[0][:, 0] == pytest.approx(levels, abs=1e-6)
    truth = np.array([level(hertz, each) for each in levels])
    seen = truth > 1.0
    assert np.sqrt(np.mean((mean - truth)[seen] ** 2)) < 1.0
    assert np.mean(((low <= truth) & (truth <= high))[seen]) >= 0.9


def test_estimate__biases_and_law_put_in__are_found_with_interval_and_evidence() -> None:
    found = estimate(matched(shifted(2.0, 0.0), 800, 5, order_db=2.0, standard_db=-1.5, sd=3.0), SETTING)
    assert found.order_db.value == pytest.approx(2.0, abs=0.6)
    assert found.standard_db.value == pytest.approx(-1.5, abs=0.6)
    assert found.order_db.low < 2.0 < found.order_db.high
    assert found.jnd_db.value == pytest.approx(0.674 * 3.0, rel=0.25)
    with pytest.raises(BadInput, match="19 matches; expected 20 or more"):
        estimate(matched(shifted(0.0, 0.0), 19, 1), SETTING)
    equal = estimate(matched(shifted(0.0, 0.0), 500, 7), SETTING)
    assert equal.intensity_function in ("sensation-level", CANNOT_TELL)
    assert equal.evidence["sensation-level"] > 0.8
    assert estimate(matched(shifted(4.0, 0.0), 500, 7), SETTING).intensity_function in ("free", CANNOT_TELL)


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.name)
def test_fit__gradient_of_every_law__is_that_of_differences(function) -> None:
    found = fit(function, SETTING, matched(shifted(2.0, 0.0), 60, 4), steps=3)
    surface = found.surface(np.array([15.0, 60.0, 250.0]), np.array([15.0, 30.0, 45.0]))
    gradient, here = surface.gradient(found.place), surface.at(found.place)
    for index, step in enumerate(1e-4 * np.eye(found.place.size)):
        assert (surface.at(found.place + step) - here) / 1e-4 == pytest.approx(gradient[:, index], abs=1e-2)


def test_most_telling__after_a_match_at_one_place__goes_to_another() -> None:
    nothing = fit(FREE, SETTING, Matches.of([]))
    first = most_telling(nothing, AMONG, 30.0, 0.0, False, False)
    at = first.frequency_hz, first.comparison_db_sl, first.reference_db_sl
    rows = [(*at, False, False, k % 2 == 0) for k in range(12)]
    later = most_telling(fit(FREE, SETTING, Matches.of(rows)), AMONG, 30.0, 0.0, False, False)
    assert (later.frequency_hz != first.frequency_hz, later.reference_db_sl) == (True, 30.0)
    biased = fit(FREE, SETTING, matched(shifted(0.0, 0.0), 400, 6, order_db=3.0))
    at = [most_telling(biased, AMONG, 30.0, 0.0, second, False) for second in (False, True)]
    assert at[0].comparison_db_sl - at[1].comparison_db_sl > 3.0


def test_estimate__tones_of_equal_velocity__named_where_the_curve_is_known() -> None:
    def level(hertz, level_db_sl):
        return np.asarray(level_db_sl) + distance_db(hertz, level_db_sl)

    matches = matched(level, 200, 11)
    result = estimate(matches, KNOWN)
    assert result.intensity_function == "equal-velocity"
    hertz = np.array([15.0, 30.0, 60.0, 250.0])
    mean, _ = result.levels(hertz, np.full(4, 30.0))
    assert mean - 30.0 == pytest.approx(distance_db(hertz, 30.0), abs=1.2)
    assert "equal-velocity" not in estimate(matches, SETTING).evidence
    assert estimate(matched(shifted(0.0, 0.0), 200, 11), KNOWN).intensity_function in ("sensation-level", CANNOT_TELL)


def test_estimate__velocity_that_takes_over__lies_in_the_band_where_it_does() -> None:
    """Up to 15 dB SL of the tone itself, in proportion: a way that the sources say as little of as of any other."""

    def level(hertz, level_db_sl):
        whole = level_db_sl + distance_db(hertz, 30.0)
        return np.where(whole >= 15.0, whole, level_db_sl / (1.0 - distance_db(hertz, 30.0) / 15.0))

    hertz, off = np.geomspace(15.0, 80.0, 12), []
    for seed in (12, 13):
        result = estimate(matched(level, 400, seed), KNOWN)
        assert result.intensity_function == "equal-velocity"
        mean, sd = result.levels(hertz, np.full(12, 18.0))
        off.append((mean - level(hertz, 18.0)) / sd)
    assert np.mean(np.abs(off) <= 1.96) >= 0.9

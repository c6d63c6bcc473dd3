"""What matches tell, against people whose law is written here, with none of the estimation's code."""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.experiment.task.estimate import CANNOT_TELL, estimate
from tactuator.experiment.task.laws import FREE, LAWS
from tactuator.experiment.task.matches import Candidates, ContourSetting, Matches, fit, most_telling
from tactuator.perception.curve import curve
from tests.griffin import distance_db

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
def test_estimate__six_hundred_random_matches__finds_contours_within_a_db_inside_their_band(level) -> None:
    found = estimate(matched(level, 600, 3), SETTING)
    hertz, levels = np.geomspace(10.0, 300.0, 15), np.array([10.0, 30.0, 50.0])
    mean, low, high = found.contours(hertz, levels)
    assert np.all(np.diff(mean, axis=0) > 0.0)
    assert found.contours(np.array([100.0]), levels)[0][:, 0] == pytest.approx(levels, abs=1e-6)
    truth = np.array([level(hertz, each) for each in levels])
    seen = truth > 1.0
    assert np.sqrt(np.mean((mean - truth)[seen] ** 2)) < 1.0
    assert np.mean(((low <= truth) & (truth <= high))[seen]) >= 0.9


def test_estimate__biases_put_in__are_found_with_an_interval() -> None:
    found = estimate(matched(shifted(2.0, 0.0), 800, 5, order_db=2.0, standard_db=-1.5, sd=3.0), SETTING)
    assert found.order_db.value == pytest.approx(2.0, abs=0.6)
    assert found.standard_db.value == pytest.approx(-1.5, abs=0.6)
    assert found.order_db.low < 2.0 < found.order_db.high
    assert found.jnd_db.value == pytest.approx(0.674 * 3.0, rel=0.25)
    with pytest.raises(BadInput, match="19 matches; allowed: 20 or more"):
        estimate(matched(shifted(0.0, 0.0), 19, 1), SETTING)


def test_estimate__equal_sensation_level__has_the_evidence_and_a_tilted_law_has_not() -> None:
    equal = estimate(matched(shifted(0.0, 0.0), 500, 7), SETTING)
    assert equal.law in ("sensation-level", CANNOT_TELL)
    assert equal.laws["sensation-level"] > 0.8
    assert estimate(matched(shifted(4.0, 0.0), 500, 7), SETTING).law in ("free", CANNOT_TELL)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_fit__gradient_of_every_law__is_that_of_differences(law) -> None:
    found = fit(law, SETTING, matched(shifted(2.0, 0.0), 60, 4), steps=3)
    surface = found.surface(np.array([15.0, 60.0, 250.0]), np.array([15.0, 30.0, 45.0]))
    gradient, here = surface.gradient(found.place), surface.at(found.place)
    for index, step in enumerate(1e-4 * np.eye(found.place.size)):
        assert (surface.at(found.place + step) - here) / 1e-4 == pytest.approx(gradient[:, index], abs=1e-2)


def test_most_telling__after_a_match_at_one_place__goes_to_another_and_corrects_for_biases() -> None:
    nothing = fit(FREE, SETTING, Matches.of([]))
    first = most_telling(nothing, AMONG, 30.0, 0.0, False, False)
    at = first.frequency_hz, first.comparison_db_sl, first.reference_db_sl
    rows = [(*at, False, False, k % 2 == 0) for k in range(12)]
    later = most_telling(fit(FREE, SETTING, Matches.of(rows)), AMONG, 30.0, 0.0, False, False)
    assert (later.frequency_hz != first.frequency_hz, later.reference_db_sl) == (True, 30.0)
    biased = fit(FREE, SETTING, matched(shifted(0.0, 0.0), 400, 6, order_db=3.0))
    at = [most_telling(biased, AMONG, 30.0, 0.0, second, False) for second in (False, True)]
    assert at[0].comparison_db_sl - at[1].comparison_db_sl > 3.0


def test_estimate__tones_of_equal_velocity__are_named_where_the_threshold_curve_is_known() -> None:
    def level(hertz, level_db_sl):
        return np.asarray(level_db_sl) + distance_db(hertz, level_db_sl)

    matches = matched(level, 200, 11)
    result = estimate(matches, KNOWN)
    assert result.law == "equal-velocity"
    hertz = np.array([15.0, 30.0, 60.0, 250.0])
    mean, _ = result.levels(hertz, np.full(4, 30.0))
    assert mean - 30.0 == pytest.approx(distance_db(hertz, 30.0), abs=1.2)
    assert "equal-velocity" not in estimate(matches, SETTING).laws
    assert estimate(matched(shifted(0.0, 0.0), 200, 11), KNOWN).law in ("sensation-level", CANNOT_TELL)


def test_estimate__velocity_that_takes_over_by_the_tones_own_level__lies_in_the_band_where_it_does() -> None:
    """Up to 15 dB SL of the tone itself, in proportion: a way that the sources say as little of as of any other."""

    def level(hertz, level_db_sl):
        whole = level_db_sl + distance_db(hertz, 30.0)
        return np.where(whole >= 15.0, whole, level_db_sl / (1.0 - distance_db(hertz, 30.0) / 15.0))

    hertz, off = np.geomspace(15.0, 80.0, 12), []
    for seed in (12, 13):
        result = estimate(matched(level, 400, seed), KNOWN)
        assert result.law == "equal-velocity"
        mean, sd = result.levels(hertz, np.full(12, 18.0))
        off.append((mean - level(hertz, 18.0)) / sd)
    assert np.mean(np.abs(off) <= 1.96) >= 0.9

"""Information transfer against the project's table, scikit-learn, and closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import mutual_info_score

from tactuator.errors import BadInput
from tactuator.experiment.result.information import (
    POSTERIOR,
    all_estimates,
    confusion_counts,
    information,
    information_of,
    plug_in_bits,
)

# k, error, trials a stimulus: true bits, then means of 100 runs with evenly spread errors (facts.md, section 7).
TABLE = [
    (12, 0.30, 20, 1.67, {"plug_in": 2.04, "miller_madow": 1.90, "all_cells": 1.68, "error_rule": 1.43}),
    (39, 0.14, 20, 3.97, {"plug_in": 4.50, "miller_madow": 4.43, "all_cells": 3.16, "error_rule": 3.81}),
    (120, 0.06, 20, 6.17, {"plug_in": 6.56, "miller_madow": 6.56, "all_cells": 2.31, "error_rule": 6.08}),
]


def uniform_error_matrices(stimuli, error, trials_per_stimulus, runs, rng):
    """Confusion matrices, (runs, stimuli, stimuli), of a subject who errs at that rate, all wrong answers alike."""
    chances = np.full((stimuli, stimuli), error / (stimuli - 1))
    np.fill_diagonal(chances, 1.0 - error)
    return rng.multinomial(trials_per_stimulus, chances, size=(runs, stimuli))


def uniform_error_bits(stimuli, error):
    """The true information transfer of that subject: log2 k - H(e) - e log2(k - 1)."""
    entropy = -error * np.log2(error) - (1.0 - error) * np.log2(1.0 - error)
    return np.log2(stimuli) - entropy - error * np.log2(stimuli - 1)


@pytest.mark.parametrize(("stimuli", "error", "trials", "true_bits", "means"), TABLE)
def test_estimators__evenly_spread_errors__means_of_the_table(stimuli, error, trials, true_bits, means):
    matrices = uniform_error_matrices(stimuli, error, trials, 400, np.random.default_rng(7))
    assert uniform_error_bits(stimuli, error) == pytest.approx(true_bits, abs=0.005)
    chances = evenly(stimuli, error)
    np.fill_diagonal(chances, 1.0 - error)
    assert information_of(chances, np.full(stimuli, 1.0 / stimuli)) == pytest.approx(uniform_error_bits(stimuli, error))
    got = {name: float(bits.mean()) for name, bits in all_estimates(matrices).items()}
    for name, mean in means.items():
        assert got[name] == pytest.approx(mean, abs=0.05), name


@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.integers(2, 12))
def test_plug_in__any_matrix__is_scikit_learns_mutual_information(seed, stimuli, responses):
    counts = np.random.default_rng(seed).integers(0, 6, (stimuli, responses)) + np.eye(stimuli, responses, dtype=int)
    truth, answers = np.nonzero(counts)
    weights = counts[truth, answers]
    expected = mutual_info_score(np.repeat(truth, weights), np.repeat(answers, weights)) / np.log(2.0)
    assert plug_in_bits(counts) == pytest.approx(expected, abs=1e-9)


def test_information__perfect_answers__is_log2_of_the_stimuli():
    result = information(np.eye(8) * 40, np.random.default_rng(1), seconds_per_stimulus=0.5)
    assert result.estimates["plug_in"].bits == pytest.approx(3.0)
    assert result.estimates["plug_in"].categories == pytest.approx(8.0)
    assert result.estimates["error_rule"].bits == pytest.approx(3.0)
    assert result.share_correct == 1.0
    assert result.bits_per_second is not None
    assert result.bits_per_second["plug_in"] == pytest.approx(6.0)
    assert result.warning is None
    assert result.estimates == information(np.eye(8) * 40, np.random.default_rng(1)).estimates
    few = information(np.eye(12) * 20, np.random.default_rng(1))
    assert few.warning == "240 trials for 12 x 12 cells; below 720 (5 a cell) these estimates are biased"


def test_information__of_unlike_answers_or_a_stimulus_never_presented__leaves_out_what_has_no_meaning():
    result = information([[5, 1, 2], [0, 6, 2]], np.random.default_rng(0))
    assert np.isnan([result.estimates["error_rule"].bits, result.share_correct]).all()
    assert result.no_interval == "no interval: responses are not those of the stimuli"
    with_gap = information([[9, 1, 0], [2, 8, 0], [0, 0, 0]], np.random.default_rng(0))
    assert with_gap.stimuli == 2
    assert with_gap.estimates["plug_in"].bits == pytest.approx(float(plug_in_bits(np.array([[9, 1], [2, 8]]))))
    counts = uniform_error_matrices(120, 0.06, 20, 1, np.random.default_rng(0))[0]
    few = information(counts, np.random.default_rng(1))
    assert few.no_interval == "no interval: 20 trials a stimulus; allowed: 60 or more with 120 stimuli"
    assert all(one.low_bits is None and one.high_bits is None for one in few.estimates.values())


# Ways to err: (name, stimuli, error, trials a stimulus, chances). The table's cells err evenly; the others do not.
def evenly(stimuli: int, error: float) -> np.ndarray:
    return np.full((stimuli, stimuli), error / (stimuli - 1))


def to_two_others(stimuli: int, error: float) -> np.ndarray:
    chances = np.zeros((stimuli, stimuli))
    for row in range(stimuli):
        chances[row, (row + 1) % stimuli] = 0.6 * error
        chances[row, (row + 3) % stimuli] += 0.4 * error
    return chances


def to_neighbours(stimuli: int, error: float) -> np.ndarray:
    apart = np.abs(np.arange(stimuli)[:, None] - np.arange(stimuli))
    near = np.where(apart > 0, np.exp(-apart / 2.0), 0.0)
    return np.asarray(error * near / near.sum(axis=1, keepdims=True))


def covered(stimuli: int, error: float, trials: int, way, runs: int) -> float:
    """Share of posterior intervals that hold the truth."""
    rng, hits = np.random.default_rng(3), 0
    chances = way(stimuli, error)
    np.fill_diagonal(chances, 0.0)
    np.fill_diagonal(chances, 1.0 - chances.sum(axis=1))
    truth = float(information_of(chances, np.full(stimuli, 1.0 / stimuli)))
    for _ in range(runs):
        counts = np.array([rng.multinomial(trials, row) for row in chances])
        found = information(counts, rng, draws=200).estimates[POSTERIOR]
        assert found.low_bits is not None
        assert found.high_bits is not None
        hits += found.low_bits <= truth <= found.high_bits
    return hits / runs


@pytest.mark.parametrize(("stimuli", "error", "trials"), [(12, 0.05, 20), (6, 0.2, 60)])
@pytest.mark.parametrize("way", [evenly, to_two_others])
def test_information__interval__covers_the_truth_whichever_way_people_err(stimuli, error, trials, way) -> None:
    assert covered(stimuli, error, trials, way, 40) >= 0.85


@pytest.mark.soak
@pytest.mark.parametrize(("stimuli", "error", "trials"), [(12, 0.30, 20), (12, 0.05, 20), (39, 0.14, 20), (6, 0.2, 60)])
@pytest.mark.parametrize("way", [evenly, to_two_others, to_neighbours])
def test_information__every_way_to_err__intervals_deserve_their_name(stimuli, error, trials, way) -> None:
    assert 0.88 <= covered(stimuli, error, trials, way, 300) <= 0.99  # 0.90 to 0.98 give or take the error of 300 runs


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ([1, 2, 3], "shape"),
        ([[1], [2]], "shape"),
        ([[1, -1], [0, 2]], "not a count"),
        ([[1, 0.5], [0, 2]], "not a count"),
        ([[1, np.nan], [0, 2]], "not a count"),
        ([[3, 1], [0, 0]], "1 stimuli were presented"),
    ],
)
def test_confusion_counts__not_a_matrix_of_counts__refused(matrix, words):
    with pytest.raises(BadInput, match=words):
        confusion_counts(matrix)
    for options in ({"confidence": 1.0}, {"draws": 0}, {"seconds_per_stimulus": 0.0}):
        with pytest.raises(BadInput, match="allowed"):
            information(np.eye(3), np.random.default_rng(0), **options)

"""Information transfer against the project's table, scikit-learn, and closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import mutual_info_score

from tactuator.errors import BadInput
from tactuator.experiment.result.information import all_estimates, confusion_counts, information, plug_in_bits
from tactuator.experiment.simulated.information_simulation import uniform_error_bits, uniform_error_matrices

# k, error, trials a stimulus: true bits, then means of 100 runs with evenly spread errors (facts.md, section 7).
TABLE = [
    (12, 0.30, 20, 1.67, {"plug_in": 2.04, "miller_madow": 1.90, "all_cells": 1.68, "error_rule": 1.43}),
    (39, 0.14, 20, 3.97, {"plug_in": 4.50, "miller_madow": 4.43, "all_cells": 3.16, "error_rule": 3.81}),
    (120, 0.06, 20, 6.17, {"plug_in": 6.56, "miller_madow": 6.56, "all_cells": 2.31, "error_rule": 6.08}),
    (12, 0.05, 20, 3.13, {"plug_in": 3.30, "miller_madow": 3.30, "all_cells": 2.94, "error_rule": 3.23}),
]


@pytest.mark.parametrize(("stimuli", "error", "trials", "true_bits", "means"), TABLE)
def test_estimators__evenly_spread_errors__means_of_the_table(stimuli, error, trials, true_bits, means):
    matrices = uniform_error_matrices(stimuli, error, trials, 400, np.random.default_rng(7))
    assert uniform_error_bits(stimuli, error) == pytest.approx(true_bits, abs=0.005)
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


def test_information__few_trials__warns():
    result = information(np.eye(12) * 20, np.random.default_rng(1))
    assert result.warning == "240 trials for 12 x 12 cells; below 720 (5 a cell) these estimates are biased"


def test_information__enough_trials__interval_covers_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(3)
    matrices = uniform_error_matrices(6, 0.2, 60, 200, rng)
    true_bits = uniform_error_bits(6, 0.2)
    hits = 0
    for matrix in matrices:
        estimate = information(matrix, rng, resamples=300).estimates["plug_in"]
        hits += estimate.low_bits <= true_bits <= estimate.high_bits
    assert 0.90 <= hits / len(matrices) <= 0.99


def test_information__same_seed__same_interval():
    matrix = uniform_error_matrices(5, 0.3, 20, 1, np.random.default_rng(2))[0]
    first, second = (information(matrix, np.random.default_rng(9)).estimates for _ in range(2))
    assert first == second


def test_information__answers_outside_the_set__has_no_error_rule():
    result = information([[5, 1, 2], [0, 6, 2]], np.random.default_rng(0))
    assert np.isnan(result.estimates["error_rule"].bits)
    assert np.isnan(result.share_correct)


def test_information__stimulus_never_presented__counts_for_nothing():
    rng = np.random.default_rng
    with_gap = information([[9, 1, 0], [2, 8, 0], [0, 0, 0]], rng(0))
    assert with_gap.stimuli == 2
    assert with_gap.estimates["plug_in"].bits == pytest.approx(float(plug_in_bits(np.array([[9, 1], [2, 8]]))))


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


@pytest.mark.parametrize("options", [{"confidence": 1.0}, {"resamples": 0}, {"seconds_per_stimulus": 0.0}])
def test_information__impossible_options__refused(options):
    with pytest.raises(BadInput, match="allowed"):
        information(np.eye(3), np.random.default_rng(0), **options)


def test_uniform_error_matrices__impossible_subject__refused():
    with pytest.raises(BadInput, match="allowed"):
        uniform_error_matrices(1, 0.1, 5, 1, np.random.default_rng(0))

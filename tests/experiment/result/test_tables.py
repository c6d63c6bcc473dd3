"""Tables of results have no word of their own: each stands in the language file."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tactuator.experiment.result.confusion import (
    AbxResult,
    SubjectResult,
    abx_table,
    information_table,
    matrix_table,
    threshold_table,
)
from tactuator.experiment.result.information import ESTIMATORS, POSTERIOR, information
from tactuator.experiment.result.thresholds import DOUBTFUL, MeasuredThreshold
from tactuator.experiment.words import Words, shipped_languages, shipped_words
from tactuator.table import ResultTable

MARKED = Words("qps", {key: f"⟦{text}⟧" for key, text in shipped_words("en").texts.items()})

ONE = MeasuredThreshold(
    subject="7", group="unknown", finger="8", frequency_hz=100.0, procedure="quest-plus", run=1, trials=48, point=0.794,
    own_db_sl=1.0, own_standard_error_db=1.0, refit_db_sl=1.1, refit_sd_db=1.0, refit_low_db_sl=-1.0,
    refit_high_db_sl=3.0, bound="", delivered_db=0.0, delivered_sd_db=0.1, own_level_db_re_1um=1.0,
    level_db_re_1um=1.1, level_low_db_re_1um=-1.0, level_high_db_re_1um=3.0, sd_db=1.0, curve="bolanowski-1988",
    flags=tuple(sorted(DOUBTFUL)), lapse_power=0.2, drift_power=0.2, simulated=True,
)  # fmt: skip


def words_left(table: ResultTable) -> list[str]:
    """Return texts of the table that hold a word outside of brackets."""
    texts = [table.caption, *table.columns, *(cell for row in table.rows for cell in row), *table.notes]
    left = []
    for text in texts:
        for _ in range(3):  # a text may hold another
            text = re.sub(r"⟦[^⟦⟧]*⟧", "", text)
        left.append(text)
    return [text for text in left if re.search("[A-Za-z]{2}", text)]


@pytest.mark.parametrize(
    "counts", [np.eye(12) * 20, np.eye(60) * 5, np.array([[5, 1, 2], [0, 6, 2]]), np.diag([9.0, 8.0, 0.0])]
)
def test_tables__information_in_a_language_of_ones_own__has_no_other_word(counts) -> None:
    found = information(counts, np.random.default_rng(0), seconds_per_stimulus=0.5)
    assert words_left(information_table(MARKED("results.information"), found, MARKED)) == []


def test_tables__of_thresholds__have_no_other_word_and_no_digit_or_end_that_is_left_open() -> None:
    table = threshold_table([ONE, replace(ONE, bound=">=")], MARKED)
    assert len(table.notes) == 4
    assert words_left(table) == []
    one = replace(ONE, refit_db_sl=1.26, refit_low_db_sl=-1.4, refit_high_db_sl=3.9, level_db_re_1um=-7.44)
    (row,) = threshold_table([one], MARKED).rows
    assert (row[5], row[7]) == ("1.3", "-7.4")
    for low, high, told in (
        (-1.0, np.inf, "≥ -1.0"), (-np.inf, 3.0, "≤ 3.0"), (-1.0, 3.0, "-1.0 to 3.0"), (-np.inf, np.inf, "–"),
    ):  # fmt: skip
        (row,) = threshold_table([replace(ONE, refit_low_db_sl=low, refit_high_db_sl=high)], shipped_words("en")).rows
        assert row[6] == told


def test_tables__notch_that_is_not_excluded__is_told_with_the_trials_that_would() -> None:
    points = [replace(ONE, procedure="curve", frequency_hz=hertz, notch_trials=count) for hertz, count in
              ((10.0, 0), (192.0, 3), (250.0, 4))]  # fmt: skip
    notes = threshold_table(points, shipped_words("en")).notes
    (told,) = [note for note in notes if "notch" in note]
    assert told == ("7: a notch of 15 dB is not excluded at 192 Hz (3 more trials would), 250 Hz (4 more trials would)")
    assert not words_left(threshold_table(points, MARKED))
    assert not any("notch" in note for note in threshold_table([ONE], shipped_words("en")).notes)


def test_tables__recognition__have_no_other_word_and_say_what_nobody_felt() -> None:
    words, counts = shipped_words("en"), np.array([[9, 1], [2, 8]])
    of_people = SubjectResult(
        "9", "recognition", "7", ("1", "2"), counts, 1.0, information(counts, np.random.default_rng(0))
    )
    abx = AbxResult("9", "7", 10, 0.9)
    assert words_left(matrix_table(of_people, MARKED)) == words_left(abx_table(abx, MARKED)) == []
    for simulated in (False, True):
        matrix = replace(of_people, simulated=simulated)
        tables = (
            matrix_table(matrix, words),
            information_table("9", matrix.information, words, matrix.simulated),
            abx_table(replace(abx, simulated=simulated), words),
        )
        assert ["simulated: nobody felt this" in table.notes for table in tables] == [simulated] * 3


@pytest.mark.parametrize("language", shipped_languages())
def test_languages__every_flag_and_estimator__has_a_text(language: str) -> None:
    texts = shipped_words(language).texts
    flags = {"cue", "floor", "ceiling", "trial-limit", "out-of-range", "saturated", "delivered-unknown", *DOUBTFUL}
    assert {f"results.flag_{name.replace('-', '_')}" for name in flags} <= set(texts)
    assert {f"results.estimator_{name}" for name in (*ESTIMATORS, POSTERIOR)} <= set(texts)

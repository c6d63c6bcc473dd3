"""Threshold curves and confusion matrices as CSV: there and back, and every refusal."""

from pathlib import Path

import numpy as np
import pytest

from tactuator.io.csv_tables import read_contours, read_curve, read_matrix, resolve_curve, write_contours, write_curve
from tactuator.perception.contours import Contours
from tactuator.perception.curve import Contact, ThresholdCurve

PALM = Contact("thenar", 290.0, "rigid, gap 1 mm", 0.5, (20.0, 31.5))


def test_write_curve__with_errors_and_where_it_was_felt__is_read_back_whole(tmp_path: Path) -> None:
    hertz, level, origin = [1.0, 10.0, 300.0], [26.0, 19.1, -18.0], ("measured", "three observers")
    curve = ThresholdCurve("mine", hertz, level, *origin, np.ones(3), contact=PALM)
    write_curve(tmp_path / "mine.csv", curve)
    again = read_curve(tmp_path / "mine.csv")
    assert again == curve
    assert (again.provenance, again.source, again.contact) == (*origin, PALM)
    assert again.standard_error_db is not None


TABLE = np.array([[10.0, 10.1, 12.0], [20.0, 20.3, 1.0 / 3.0 + 25.0]])


@pytest.mark.parametrize("band", [(TABLE - 1.0, TABLE + 1.5), (None, None)], ids=["banded", "plain"])
def test_write_contours__with_a_band_or_without__is_read_back_whole(tmp_path: Path, band) -> None:
    origin = (63.0, "measured", "matches, one person", PALM)
    there = Contours("P7", [63.0, 64.0, 250.0], [10.0, 20.0], TABLE, *band, *origin)
    write_contours(tmp_path / "contours.csv", there)
    again = read_contours(tmp_path / "contours.csv")
    assert again == there
    assert (again.reference_hz, again.source, again.contact) == (63.0, "matches, one person", PALM)
    np.testing.assert_array_equal(
        again.level_db_sl_at([5.0, 15.0, 60.0], 100.0), there.level_db_sl_at([5, 15, 60], 100)
    )
    np.testing.assert_array_equal(again.high_db_sl, band[1])


def test_resolve_curve__name_or_path__finds_either(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text("frequency_hz,level_db_re_1um\n1,2\n2,3\n3,4\n")
    assert resolve_curve("bolanowski-1988", tmp_path).name == "bolanowski-1988"
    assert resolve_curve("c.csv", tmp_path).level_db_re_1um.tolist() == [2.0, 3.0, 4.0]


@pytest.mark.parametrize(
    ("text", "stimuli", "responses"),
    [
        ("5,1\n2,6\n", ("1", "2"), ("1", "2")),
        ("# a comment\npa,ba\n5,1\n2,6\n", ("1", "2"), ("pa", "ba")),
        (",pa,ba\npa,5,1\nba,2,6\n", ("pa", "ba"), ("pa", "ba")),
        ("stimulus,1,2\n1,5,1\n2,2,6\n", ("1", "2"), ("1", "2")),
        ("pa,5,1\nba,2,6\n", ("pa", "ba"), ("1", "2")),
        ("\ufeff,1,2\n1, 5 ,1\n2,2,6\n", ("1", "2"), ("1", "2")),
    ],
)
def test_read_matrix__with_and_without_names__same_counts(tmp_path, text, stimuli, responses):
    path = tmp_path / "matrix.csv"
    path.write_text(text, encoding="utf-8")
    got = read_matrix(path)
    np.testing.assert_array_equal(got.counts, [[5, 1], [2, 6]])
    assert got.stimuli == stimuli
    assert got.responses == responses

"""Threshold curves and confusion matrices as CSV: there and back, and every refusal."""

from pathlib import Path

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.csv_tables import read_contours, read_curve, read_matrix, resolve_curve, write_contours, write_curve
from tactuator.perception.contours import Contours
from tactuator.perception.curve import Contact, ThresholdCurve


def test_write_curve__with_errors__is_read_back_whole(tmp_path: Path) -> None:
    curve = ThresholdCurve(
        "mine", np.array([1.0, 10.0, 300.0]), np.array([26.0, 19.1, -18.0]), "measured", "three observers", np.ones(3)
    )
    write_curve(tmp_path / "mine.csv", curve)
    again = read_curve(tmp_path / "mine.csv")
    assert again == curve
    assert (again.provenance, again.source) == ("measured", "three observers")
    assert again.standard_error_db is not None


PALM = Contact("thenar", 290.0, "rigid, gap 1 mm", 0.5, (20.0, 31.5))


def test_write_curve__that_says_where_it_was_felt__is_read_back_so(tmp_path: Path) -> None:
    write_curve(tmp_path / "c.csv", ThresholdCurve("c", [1.0, 2.0, 3.0], [4.0, 5.0, 6.0], contact=PALM))
    assert read_curve(tmp_path / "c.csv").contact == PALM


@pytest.mark.parametrize("banded", [True, False])
def test_write_contours__with_a_band_or_without__is_read_back_whole(tmp_path: Path, banded: bool) -> None:
    table = np.array([[10.0, 10.1, 12.0], [20.0, 20.3, 1.0 / 3.0 + 25.0]])
    band = (table - 1.0, table + 1.5) if banded else (None, None)
    there = Contours(
        "P7", [63.0, 64.0, 250.0], [10.0, 20.0], table, *band, 63.0, "measured", "matches, one person", PALM
    )
    write_contours(tmp_path / "contours.csv", there)
    again = read_contours(tmp_path / "contours.csv")
    assert again == there
    assert (again.reference_hz, again.source, again.contact) == (63.0, "matches, one person", PALM)
    np.testing.assert_array_equal(
        again.level_db_sl_at([5.0, 15.0, 60.0], 100.0), there.level_db_sl_at([5, 15, 60], 100)
    )
    if banded:
        np.testing.assert_array_equal(again.high_db_sl, table + 1.5)
    else:
        assert again.high_db_sl is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "columns nothing, 0 rows; allowed: level_db_sl, frequency_hz, db_sl"),
        ("level_db_sl,frequency_hz,db_sl\n10,30,x\n", "db_sl is 'x' in a row"),
        ("level_db_sl,frequency_hz,db_sl\n10,30,1\n10,100,10\n20,100,20\n", "3 rows for 2 contours and 2 freq"),
        ("level_db_sl,frequency_hz,db_sl\n10,30,1\n10,30,2\n10,100,10\n", "3 rows for 1 contours and 2 freq"),
        ("# name: a\n# reference_hz: x\nlevel_db_sl,frequency_hz,db_sl\n10,30,1\n", "reference_hz is x; allowed"),
        ("# name: a\n# area_mm2: x\nlevel_db_sl,frequency_hz,db_sl\n10,30,9\n10,100,10\n", "area_mm2 is 'x'"),
        ("# name: a\n# age_years: 20\nlevel_db_sl,frequency_hz,db_sl\n10,30,9\n10,100,10\n", "age_years"),
        ("# name: a\n# provenance: b\nlevel_db_sl,frequency_hz,db_sl\n10,30,9\n10,100,10\n", "provenance is 'b'"),
    ],
)
def test_read_contours__that_are_none__is_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "contours.csv").write_text(text)
    with pytest.raises(BadInput, match=words):
        read_contours(tmp_path / "contours.csv")


def test_resolve_curve__name_or_path__finds_either(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text("frequency_hz,level_db_re_1um\n1,2\n2,3\n3,4\n")
    assert resolve_curve("bolanowski-1988", tmp_path).name == "bolanowski-1988"
    assert resolve_curve("c.csv", tmp_path).level_db_re_1um.tolist() == [2.0, 3.0, 4.0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "columns nothing; allowed: frequency_hz"),
        ("hz,db\n1,2\n", "columns hz, db; allowed"),
        ("frequency_hz,level_db_re_1um\n1,x\n", "level_db_re_1um is 'x' in a row; allowed: a number"),
        ("frequency_hz,level_db_re_1um\n1,2\n2\n", "allowed"),
        ("frequency_hz,level_db_re_1um\n1,2\n2,3\n", "2 points; allowed: three or more"),
        ("frequency_hz,acceleration_m_s2_rms\n1,2\n2,-3\n3,1\n", "not a finite number"),
    ],
)
def test_read_curve__not_a_curve__is_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "c.csv").write_text(text)
    with pytest.raises(BadInput, match=words):
        read_curve(tmp_path / "c.csv")


def test_read_curve__binary_or_missing__is_refused(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInput, match="not text"):
        read_curve(tmp_path / "c.csv")
    with pytest.raises(BadInput, match="No such file"):
        read_curve(tmp_path / "none.csv")


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


@pytest.mark.parametrize(
    ("text", "words"),
    [("", "no rows"), ("1,2\n3\n", "equal length"), ("a,b\n", "equal length"), ("1,2\n3,x\n", "not a number")],
)
def test_read_matrix__not_a_matrix__refused(tmp_path, text, words):
    path = tmp_path / "matrix.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadInput, match=words):
        read_matrix(path)


def test_read_matrix__no_file__refused(tmp_path):
    with pytest.raises(BadInput, match="No such file"):
        read_matrix(tmp_path / "none.csv")

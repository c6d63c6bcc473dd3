"""Threshold curves and confusion matrices as CSV: there and back, and every refusal."""

from pathlib import Path

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.csv_tables import read_curve, read_matrix, resolve_curve, write_curve
from tactuator.perception.curve import ThresholdCurve


def test_write_curve__with_errors__is_read_back_whole(tmp_path: Path) -> None:
    curve = ThresholdCurve(
        "mine", np.array([1.0, 10.0, 300.0]), np.array([26.0, 19.1, -18.0]), "measured", "three observers", np.ones(3)
    )
    write_curve(tmp_path / "mine.csv", curve)
    again = read_curve(tmp_path / "mine.csv")
    assert again == curve
    assert (again.provenance, again.source) == ("measured", "three observers")
    assert again.standard_error_db is not None


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

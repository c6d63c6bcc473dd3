"""Curves as CSV: there and back, published accelerations, refusals."""

from pathlib import Path

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.csv_tables import read_curve, resolve_curve, write_curve
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

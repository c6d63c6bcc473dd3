"""Confusion matrices as people write them."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.csv_tables import read_matrix


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

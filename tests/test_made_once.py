"""What is kept for all workers is what is computed; another question is computed by itself, and a refusal each time."""

import pytest

from tests.made_once import made_once


def test_made_once__asked_again__is_the_same_with_all_that_was_said(tmp_path):
    asked, heard = [], []

    def root(number, *, note, offset=0):
        asked.append(number)
        note(f"of {number}")
        if number < 0:
            raise ValueError(f"{number} has none")
        return number**0.5 + offset

    kept = made_once(tmp_path, root)
    assert [kept(9, note=heard.append, offset=offset) for offset in (0, 0, 1)] == [3.0, 3.0, 4.0]
    assert heard == 3 * ["of 9"]
    for _ in range(2):
        with pytest.raises(ValueError, match="-4 has none"):
            kept(-4, note=heard.append)
    assert asked == [9, 9, -4, -4]

"""What is kept for all workers is the same as what is computed, and another question is computed by itself."""

import pytest

from tests.made_once import made_once


def test_made_once__asked_again__is_the_same_with_all_that_was_said_and_another_is_computed(tmp_path):
    asked, heard = [], []

    def squared(number, *, note, offset=0):
        asked.append(number)
        note(f"squaring {number}")
        return number**2 + offset

    kept = made_once(tmp_path, squared)
    answers = [kept(number, note=heard.append, offset=offset) for number, offset in ((3, 0), (3, 0), (3, 1), (4, 0))]
    assert answers == [9, 9, 10, 16]
    assert asked == [3, 3, 4]
    assert heard == ["squaring 3", "squaring 3", "squaring 3", "squaring 4"]


def test_made_once__refusal__is_not_kept(tmp_path):
    refusals = iter([ValueError("first"), ValueError("second")])

    def refuse():
        raise next(refusals)

    kept = made_once(tmp_path, refuse)
    for words in ("first", "second"):
        with pytest.raises(ValueError, match=words):
            kept()
    assert list(tmp_path.iterdir()) == []

"""What a verb prints."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from tactuator.cli.commands import Bars, answer, drawn
from tactuator.report.tables import with_error
from tactuator.table import ResultTable
from tactuator.verbs.result import Result, plain, watched, working


@dataclass(frozen=True)
class Margin:
    phase_deg: float
    levels_db: np.ndarray


class Answer(Result):
    """A result with what is printed of it."""

    def __init__(self, document: dict[str, object], *shown: ResultTable | str) -> None:
        self.document, self.shown = document, shown

    def to_dict(self) -> dict[str, object]:
        return self.document

    def tables(self) -> Sequence[ResultTable | str]:
        return self.shown


def test_answer__as_json_or_for_a_person__one_object_or_tables_and_what_was_written(capsys):
    answer(Answer({"ok": True, "levels_db": np.array([1.5, np.inf]), "path": Path("a/b"), "name": "µ"}, "no"), True)
    assert capsys.readouterr() == ('{"ok": true, "levels_db": [1.5, null], "path": "a/b", "name": "µ"}\n', "")
    table = ResultTable("", ("frequency", "level"), (("10 Hz", "50 dB SL"),), ("a note",))
    answer(Answer({}, "level [dB SL]", table), False, ["f.csv"])
    out = capsys.readouterr().out
    assert out.startswith("level [dB SL]\n")  # brackets are text
    assert "50 dB SL" in out
    assert out.endswith("a note\nwritten: f.csv\n")


def test_plain__dataclass_and_complex__become_objects_and_pairs():
    assert plain(Margin(58.6, np.array([1.0]))) == {"phase_deg": 58.6, "levels_db": [1.0]}
    numbers = {1: np.complex64(1 + 2j), "n": np.int64(3), "t": (np.bool_(True), None)}
    assert plain(numbers) == {"1": [1.0, 2.0], "n": 3, "t": [True, None]}
    with pytest.raises(TypeError, match="set"):
        plain({"members": {1, 2}})


texts = st.text('a"\\/\n\0\x7fµ\u2028\ud800😀')  # all that JSON treats in a way of its own
values = st.recursive(
    st.none() | st.booleans() | st.integers() | texts | st.floats() | st.sampled_from([np.inf, -np.inf, np.nan]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
)


@given(values)
def test_plain__any_value__survives_strict_json(value):
    assert json.loads(json.dumps(plain(value), allow_nan=False)) == plain(value)


def test_progress__nobody_watching__is_silent(capsys):
    with watched(Bars()), working("counting", 3) as step:
        step(1, text="one")
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (0.199196, 0.000243, ("0.19920", "0.00024")),
        (2739.95, 0.367, ("2739.95", "0.37")),
        (-31.812, 1.4, ("-31.8", "1.4")),
        (0.0, 0.0, ("0", "0")),
        (1.5, float("inf"), ("1.5", "inf")),
        (8.2572e7, 3.1e4, ("8.2572e+07", "3.1e+04")),
        (8.016e-9, 1.7e-11, ("8.016e-09", "1.7e-11")),
        (0.0, 3.0e-9, ("0", "3e-09")),
        (12.0, 250.0, ("12", "250")),
    ],
)
def test_with_error__value__has_the_digits_that_its_error_leaves(value, error, shown):
    assert with_error(value, error) == shown


@pytest.mark.parametrize("width", [60, 80, 160])
def test_shown__table_wider_than_the_terminal__loses_no_letter(width):
    columns = ("subject", "finger", "Hz", "trials", "procedure", "refit", "95 %", "dB re 1 µm", "flags")
    row = ("S1", "middle", "164.3", "129", "-12.5", "≥ 29.5", "8.5 to 54.2", "15.8", "chance, delivered-unknown")
    console = Console(width=width, record=True, file=StringIO())
    console.print(drawn(ResultTable("Thresholds", columns, (row,), ("a note",)), console))
    lines = console.export_text().splitlines()
    assert max(len(line) for line in lines) <= width
    letters, given_ones = Counter("".join(lines)), Counter("".join(columns + row).replace(" ", ""))
    assert all(letters[letter] >= count for letter, count in given_ones.items())
    assert "…" not in letters
    assert width < 80 or Counter(" ".join(columns + row).split()) <= Counter(" ".join(lines).split())  # words are whole


def test_shown__no_room_for_all_words__numbers_stay_whole():
    columns = ("channel", "Hz", "felt", "error dB", "± dB", "prefilter", "load", "rest", "phase °", "delay ms", "dist.")
    row = ("thumbside", "246", "24.96", "-0.04", "0.00028", "-0.06", "+0.00", "+0.02", "-147.4", "1.66", "-52")
    console = Console(width=68, record=True, file=StringIO())
    console.print(drawn(ResultTable("", columns, (row,)), console))
    assert set(row[1:]) <= set(console.export_text().split())

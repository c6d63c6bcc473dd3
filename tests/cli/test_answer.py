"""What a verb prints."""

import json
from collections import Counter
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from rich.table import Table

from tactuator.api.plain import plain
from tactuator.cli.answer import answer, progress, shown
from tactuator.experiment.result.confusion import ResultTable
from tactuator.report.tables import with_error


@dataclass(frozen=True)
class Margin:
    phase_deg: float
    levels_db: np.ndarray


def test_answer__as_json__is_exactly_one_object(capsys):
    answer({"ok": True, "levels_db": np.array([1.5, np.inf]), "path": Path("a/b"), "name": "µ"}, True, "not shown")
    out, err = capsys.readouterr()
    assert out == '{"ok": true, "levels_db": [1.5, null], "path": "a/b", "name": "µ"}\n'
    assert err == ""


def test_answer__for_a_person__shows_the_table(capsys):
    table = Table("frequency", "level")
    table.add_row("10 Hz", "50 dB SL")
    answer({"ok": True}, False, table)
    assert "50 dB SL" in capsys.readouterr().out


def test_answer__text_in_brackets__is_shown_as_it_is(capsys):
    answer({}, False, "level [dB SL]")
    assert capsys.readouterr().out == "level [dB SL]\n"


def test_plain__dataclass_and_complex__become_objects_and_pairs():
    assert plain(Margin(58.6, np.array([1.0]))) == {"phase_deg": 58.6, "levels_db": [1.0]}
    assert plain({1: np.complex64(1 + 2j), "n": np.int64(3), "t": (np.bool_(True), None)}) == {
        "1": [1.0, 2.0],
        "n": 3,
        "t": [True, None],
    }


def test_plain__what_json_cannot_say__is_refused():
    with pytest.raises(TypeError, match="set"):
        plain({"members": {1, 2}})


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text() | st.floats(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@given(values)
def test_plain__any_value__survives_strict_json(value):
    assert json.loads(json.dumps(plain(value), allow_nan=False)) == plain(value)


def test_progress__nobody_watching__is_silent(capsys):
    with progress() as bars:
        for _ in bars.track(range(3), description="counting"):
            pass
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (0.199196, 0.000243, ("0.19920", "0.00024")),
        (2739.95, 0.367, ("2739.95", "0.37")),
        (96.98917, 0.0183, ("96.989", "0.018")),
        (-31.812, 1.4, ("-31.8", "1.4")),
        (0.0, 0.0, ("0", "0")),
        (1.5, float("inf"), ("1.5", "inf")),
        (8.2572e7, 3.1e4, ("8.2572e+07", "3.1e+04")),
        (8.016e-9, 1.7e-11, ("8.016e-09", "1.7e-11")),
        (0.0, 3.0e-9, ("0", "3e-09")),
        (12.0, 250.0, ("12", "250")),
        (4.62278e12, 7.5e9, ("4.6228e+12", "7.5e+09")),
    ],
)
def test_with_error__value__has_the_digits_that_its_error_leaves(value, error, shown):
    assert with_error(value, error) == shown


@pytest.mark.parametrize("width", [60, 80, 100, 160])
def test_shown__table_wider_than_the_terminal__loses_no_letter(width):
    columns = ("subject", "finger", "Hz", "trials", "procedure", "refit", "95 %", "dB re 1 µm", "flags")
    row = ("S1", "middle", "164.3", "129", "-12.5", "≥ 29.5", "8.5 to 54.2", "15.8", "chance, delivered-unknown")
    console = Console(width=width, record=True, file=StringIO())
    console.print(shown(ResultTable("Thresholds", columns, (row,), ("a note",))))
    lines = console.export_text().splitlines()
    assert max(len(line) for line in lines) <= width
    letters = Counter("".join(lines))
    assert all(letters[one] >= count for one, count in Counter("".join(columns + row).replace(" ", "")).items())
    assert "…" not in letters

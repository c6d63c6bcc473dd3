"""CSV files of figures, curves and responses: text is never executed by a spreadsheet, and numbers stay numbers."""

import csv

import numpy as np
import pytest

from tactuator.io.csv_tables import curve_text, read_curve
from tactuator.io.csv_text import cell, csv_text
from tactuator.io.response import responses_csv
from tactuator.perception.curve import curve
from tactuator.report.figure import ReportFigure
from tactuator.signals.record import Response

FORMULAS = ["=1+1", "+1", "-2+3", "@SUM(A1)", "\tx", " =1", "\uff1dA1", "-1E5x", "-"]


@pytest.mark.parametrize("text", FORMULAS)
def test_cell__text_that_a_spreadsheet_executes__begins_with_an_apostrophe(text) -> None:
    assert cell(text) == f"'{text}"


def test_cell__numbers_and_texts_of_numbers__stay_as_they_are() -> None:
    assert [cell(-3.5), cell(None), cell("plain"), cell("1-2")] == [-3.5, "", "plain", "1-2"]
    assert [cell("-5"), cell("-1.5E-3")] == ["-5", "-1.5E-3"]
    assert csv_text(["a", "=b"], [[-0.25, -np.inf], [None, "-x"]], digits=9) == "a,'=b\n-0.25,-inf\n,'-x\n"


def drawn(text: str) -> str:
    return ReportFigure("f", "", "", "<svg/>", {"who": [text, text], "gain_db": [-1.0, -2.5]}).csv()


def measured(text: str) -> str:
    point, yes = np.array([-3.0]), np.array([False])
    response = Response(
        text, "free", -5.0, "lines", np.array([8.0]), point + 0j, point, point, point, point, yes, yes, point
    )
    return responses_csv([response])


def of_people(text: str) -> str:
    shipped = curve("bolanowski-1988")
    return curve_text(shipped, {"site": [text] * shipped.frequency_hz.size})


@pytest.mark.parametrize("text", FORMULAS)
@pytest.mark.parametrize("write", [drawn, measured, of_people])
def test_csv__text_of_a_person_that_begins_a_formula__is_text_and_negative_numbers_are_numbers(write, text) -> None:
    lines = [line for line in write(text).splitlines(keepends=True) if not line.startswith("#")]
    header, *rows = csv.reader(lines)
    assert rows
    cells = [value for row in rows for value in row]
    assert f"'{text}" in cells
    assert text not in cells
    assert any(float(value) < 0.0 for value in cells if value.startswith("-"))
    assert "who" in header or "frequency_hz" in header


def test_curve__with_a_formula_in_a_circumstance__is_read_back_the_same(tmp_path) -> None:
    (tmp_path / "curve.csv").write_text(of_people("=1+1"), encoding="utf-8")
    again, shipped = read_curve(tmp_path / "curve.csv"), curve("bolanowski-1988")
    np.testing.assert_array_equal(again.level_db_re_1um, shipped.level_db_re_1um)

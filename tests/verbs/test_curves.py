"""The verb `curves`: the library and a person's own, each with where it was felt."""

import json
from pathlib import Path

import pytest

from tactuator.cli.main import main
from tactuator.io.csv_tables import write_curve
from tactuator.perception.curve import Contact, ThresholdCurve, curve_names
from tactuator.verbs.start import curves

MINE = ThresholdCurve(
    "mine", [1.0, 30.0, 300.0], [20.0, 10.0, -10.0], "measured", "me", [1.0] * 3, Contact("index fingertip", 50.0)
)


def test_curves__with_one_of_ones_own__stand_beside_each_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.csv"
    write_curve(mine, MINE)
    assert main(["curves", str(mine), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    last = document["curves"][-1]
    assert (last["name"], last["contact"]["site"], last["contact"]["area_mm2"]) == ("mine", "index fingertip", 50.0)
    (table,) = curves([mine]).tables()  # a fingertip's is among them
    assert curves().tables()[1] == "none of these was felt at a fingertip: measure your own"
    assert table.rows[-1][:5] == ("mine", "measured", "1 to 300 Hz", "index fingertip", "50 mm²")
    assert table.rows[-1][5] == "not stated"
    assert [line.label for line in curves([mine]).chart().curves][-1] == "mine (index fingertip, measured)"
    assert main(["curves", str(mine), "--figures", str(tmp_path / "drawn")]) == 0
    assert (tmp_path / "drawn" / "curves.svg").is_file()
    listed = curves().curves
    assert tuple(curve.name for curve in listed) == curve_names()
    assert all(curve.contact.site for curve in listed)

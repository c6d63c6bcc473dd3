"""The tour's Python runs as it is printed."""

import re
from pathlib import Path

import pytest

TOUR = Path(__file__).resolve().parents[2] / "docs" / "tour.md"


def test_tour__its_python__runs(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```", TOUR.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    exec(compile(code, TOUR.name, "exec"), {})
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines() if "[" in line][:3] == [
        "index",
        "thumb",
        "middle",
    ]

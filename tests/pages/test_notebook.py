"""The notebook runs from its first cell to its last, and shows something under each."""

import ast
import json
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import tactuator as tt

NOTEBOOK = Path(__file__).parents[2] / "docs" / "tutorials" / "chain.ipynb"
CELLS = ["".join(cell["source"]) for cell in json.loads(NOTEBOOK.read_text())["cells"] if cell["cell_type"] == "code"]


def shown(cell: str, names: dict[str, object]) -> object:
    """Run a cell and return what a notebook shows under it: the value of its last line."""
    *before, last = ast.parse(cell).body
    assert isinstance(last, ast.Expr)
    exec(compile(ast.Module(before, []), "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


@pytest.mark.slow
def test_notebook__each_cell__runs_and_shows_what_it_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    values = [shown(cell, names) for cell in CELLS]
    plt.close("all")
    assert len(CELLS) == 9
    assert "fit: 99.75 %, trusted: yes" in repr(values[1])
    assert values[3].phase_margin_deg == pytest.approx(53.1, abs=0.1)  # type: ignore[attr-defined]
    assert repr(values[5]) == "<Verdict verdict: met (i, ii, iii, iv, build: met)>"
    assert tt.read_image(tmp_path / "image.bin").channels == 1

"""The whole study, run once with the default seed."""

from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import pytest

from tactuator.api.parameters import paper_display
from tactuator.api.speech import speech_source
from tactuator.cli import main
from tactuator.paper import reproduce as command
from tactuator.paper.plan import Plan
from tactuator.paper.study import PaperStudy, run_study
from tactuator.report.figure import ReportFigure


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What needs the study takes its fifteen seconds: it is among the slow tests."""
    for item in items:
        if "study" in getattr(item, "fixturenames", ()) and item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory) -> PaperStudy:
    folder = tmp_path_factory.mktemp("study")
    return run_study(Plan(paper_display()), folder, speech_source(None), lambda step, done: None)


@dataclass(frozen=True)
class Reproduced:
    folder: Path
    printed: str


@pytest.fixture(scope="session")
def reproduced(study: PaperStudy, tmp_path_factory: pytest.TempPathFactory) -> Reproduced:
    """The command itself, with the study that was run. Of the figures one is drawn: all are in a slow test."""
    folder = tmp_path_factory.mktemp("reproduce") / "paper"
    draw = ReportFigure.svg
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as printed:
        patch.setattr(
            ReportFigure, "svg", lambda figure: draw(figure) if figure.name == "fig01" else f"of {figure.name}"
        )
        patch.setattr(command, "run_study", lambda plan, folder, file, tell: study)
        assert main(["reproduce", "--json", "--out", str(folder)]) == 0
    return Reproduced(folder, printed.getvalue())

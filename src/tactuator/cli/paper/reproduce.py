"""The verb `reproduce`: the paper's study, end to end, on the simulated display."""

from __future__ import annotations

from pathlib import Path

from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, progress
from tactuator.io.atomic import atomic_folder
from tactuator.paper.plan import Plan, Progress, paper_display
from tactuator.paper.publication.comparison import comparison
from tactuator.paper.publication.publish import OWN_NAMES, publish
from tactuator.paper.publication.summary import summary
from tactuator.paper.run import STEPS, PaperStudy, run_study
from tactuator.paper.speech import check_speech
from tactuator.speech.reading import SpeechFile


def run(out: Path, speech: Path | None, seed: int, as_json: bool) -> None:
    """Run the paper's study on the simulated display: report.html, figures and summary.json in the folder."""
    plan = Plan(paper_display(), seed, speech)
    file = check_speech(plan)
    with atomic_folder(out, OWN_NAMES) as folder:
        study = _watched(plan, file)
        publish(study, folder)
    answer(summary(study), as_json, _shown(study, out))


def _watched(plan: Plan, file: SpeechFile) -> PaperStudy:
    """Run the study with a bar for each of its steps."""
    with progress() as bars:
        tasks = {step: bars.add_task(step, total=1.0) for step in STEPS}
        tell: Progress = lambda step, done: bars.update(tasks[step], completed=done)  # noqa: E731
        return run_study(plan, file, tell)


def _shown(study: PaperStudy, out: Path) -> Group:
    table = Table("", "paper (2004)", "here", title="The paper, end to end")
    for row in comparison(study):
        table.add_row(row.what, row.paper, row.here)
    notes = [f"note: {note}" for note in study.spoken.file.notes]
    return Group(table, *notes, f"report: {out / 'report.html'}")

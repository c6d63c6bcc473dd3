"""The command `reproduce`: the paper's study, end to end, on the simulated display."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from tactuator.api.option import Option
from tactuator.api.parameters import Place, Seed, paper_display
from tactuator.api.progress import working
from tactuator.api.speech import speech_source
from tactuator.io.atomic import atomic_folder
from tactuator.paper.plan import Plan
from tactuator.paper.report import OWN_NAMES, publish
from tactuator.paper.study import STEPS, run_study
from tactuator.paper.summary import HEADS, comparison, summary
from tactuator.result import Column, Fact, Result, ResultTable, data, found, text_table

_SUMMARISED = 6
"""Rows of the comparison that the summary has."""


@dataclass(frozen=True, eq=False, repr=False)
class PaperResult(Result):
    """The paper's study. folder: report.html, figures and summary.json; summary: its figures; comparison: rows of what,
    the paper's printed design, ours, what it rests on; remarks: on the speech that was presented.
    """

    folder: Path
    summary: Mapping[str, Any]
    comparison: tuple[tuple[str, str, str, str], ...]
    remarks: tuple[str, ...] = ()

    def facts(self) -> Sequence[Fact]:
        compared = [
            Fact("", here, what, summary=row < _SUMMARISED) for row, (what, _, here, _) in enumerate(self.comparison)
        ]
        return [found("report", self.folder / "report.html"), *compared, *data(self.summary)]

    def table(self) -> Sequence[Column]:
        columns = zip(*self.comparison, strict=True)
        return [Column(name, cells, name) for name, cells in zip(HEADS, columns, strict=True)]

    def tables(self) -> Sequence[ResultTable | str]:
        return [text_table(self.table(), "The paper, end to end"), *(f"note: {remark}" for remark in self.remarks)]


def reproduce(
    folder: Annotated[
        Place,
        Option("Folder to write; replaced if it is a former report.", ("--out",), type=Path, shell=Path("out/paper")),
    ] = "out/paper",
    speech: Annotated[Place | None, Option("WAV or FLAC to present (default: a recorded sentence).", file=True)] = None,
    seed: Seed = 1,
) -> PaperResult:
    """Run the paper's study on the simulated display. Takes minutes; writes report.html, figures, summary.json and the
    files of every step.

    >>> tt.reproduce("paper", speech="nothing.wav")
    Traceback (most recent call last):
    ...
    tactuator.errors.BadInput: nothing.wav: file not found
    """
    plan = Plan(paper_display(), seed)
    file = speech_source(speech)
    with atomic_folder(folder, OWN_NAMES) as beside, ExitStack() as stack:
        steps = {name: stack.enter_context(working(name, 1.0)) for name in STEPS}
        (beside / "files").mkdir()
        study = run_study(plan, beside / "files", file, lambda name, done: steps[name](done))
        publish(study, beside)
    notes = tuple(study.spoken[0].result.notices())
    return PaperResult(Path(folder), summary(study), comparison(study), notes)

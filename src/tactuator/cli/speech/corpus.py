"""The verb `corpus`: a tree of speech files to references, on this machine's cores or a Dask cluster."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import typer
from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, progress, written
from tactuator.cli.chosen import chosen_controller
from tactuator.corpus.corpus import MANIFEST, CorpusResult, run_corpus
from tactuator.corpus.workers import DaskCluster, LocalProcesses, Workers
from tactuator.errors import BadInput
from tactuator.speech.coding import coding_of
from tactuator.speech.render import RenderJob


def run(
    folder: Path,
    out: Path,
    display: Path | None,
    controller: Path | None,
    coding: str,
    level: float,
    felt: bool,
    hdf5: bool,
    workers: int | None,
    scheduler: str | None,
    seed: int,
    as_json: bool,
) -> None:
    """Render a corpus: restartable, with a manifest; exit status 1 if a file failed."""
    if workers is not None and scheduler is not None:
        raise BadInput("--workers with --scheduler", "one of them, since a cluster has its own")
    chosen = coding_of(coding)
    job = RenderJob(chosen_controller(display, controller), chosen, level, felt, seed)
    with ExitStack() as stack:
        doers: Workers
        if scheduler is None:
            doers = LocalProcesses(workers)
        else:
            doers = stack.enter_context(DaskCluster(scheduler))
        bars = stack.enter_context(progress())
        task = bars.add_task("corpus", total=None)
        result = run_corpus(
            folder,
            out,
            job,
            doers,
            ".h5" if hdf5 else ".wav",
            lambda done, total: bars.update(task, completed=done, total=total),
        )
    figures = {
        "out": str(out),
        "manifest": str(out / MANIFEST),
        "rendered": result.done,
        "kept": result.kept,
        "failures": result.failures,
        "duration_s": result.manifest["duration_s"],
    }
    answer(figures, as_json, _shown(result, out))
    if result.failures:
        raise typer.Exit(1)


def _shown(result: CorpusResult, out: Path) -> Group:
    table = Table("what", "files", title="Corpus")
    for words, count in (
        ("rendered", result.done),
        ("kept from an earlier run", result.kept),
        ("failed", len(result.failures)),
    ):
        table.add_row(words, str(count))
    failed = (f"failed: {failure['error']}" for failure in result.failures)
    return Group(table, *failed, *written(out, out / MANIFEST))

"""The verb `corpus`: a tree of speech files to references, on this machine's cores or a Dask cluster."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, progress
from tactuator.cli.options import AsJson, ControllerOption, DisplayOption, Seed, chosen_controller
from tactuator.corpus.corpus import MANIFEST, CorpusResult, run_corpus
from tactuator.corpus.workers import DaskCluster, LocalProcesses, Workers
from tactuator.errors import BadInput
from tactuator.speech.coding.file import coding_of
from tactuator.speech.job import RenderJob
from tactuator.speech.render import LEVEL_DB_SL


def register(app: typer.Typer) -> None:
    """Add the verb to the application."""

    @app.command()
    def corpus(
        folder: Annotated[Path, typer.Argument(help="Folder of speech files, looked through to its depths.")],
        out: Annotated[Path, typer.Option("--out", help="Folder of references; what is finished there is kept.")],
        display: DisplayOption = None,
        controller: ControllerOption = None,
        coding: Annotated[str, typer.Option("--coding", help="As for `render`.")] = "direct",
        level: Annotated[float, typer.Option("--level", help="Level of every utterance, dB SL.")] = LEVEL_DB_SL,
        felt: Annotated[bool, typer.Option("--felt", help="Put what is felt of each file into the manifest.")] = False,
        hdf5: Annotated[bool, typer.Option("--hdf5", help="References as .h5 in place of .wav.")] = False,
        workers: Annotated[int | None, typer.Option("--workers", min=1, help="Processes (default: cores).")] = None,
        scheduler: Annotated[str | None, typer.Option("--scheduler", help="Address of a Dask scheduler.")] = None,
        seed: Seed = 0,
        as_json: AsJson = False,
    ) -> None:
        """Render a corpus: restartable, with a manifest; exit status 1 if a file failed."""
        if workers is not None and scheduler is not None:
            raise BadInput("--workers with --scheduler; allowed: one of them, since a cluster has its own")
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
    table = Table("", "files", title=str(out))
    for words, count in (
        ("rendered", result.done),
        ("kept from an earlier run", result.kept),
        ("failed", len(result.failures)),
    ):
        table.add_row(words, str(count))
    return Group(table, *(f"failed: {failure['error']}" for failure in result.failures))

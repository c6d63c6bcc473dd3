"""The verb `corpus`: a tree of speech files to references, on this machine's cores or a Dask cluster."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tactuator.errors import BadInput
from tactuator.speech.options import CODING, LEVEL_DB_SL
from tactuator.table import ResultTable, picked
from tactuator.verbs.parameters import Argument, ControllerOption, DisplayOption, Option, Place, Seed, chosen_controller
from tactuator.verbs.result import Result, working

if TYPE_CHECKING:
    from tactuator.corpus.corpus import CorpusResult


@dataclass(frozen=True, eq=False, repr=False)
class RenderedCorpus(Result):
    """A corpus that was rendered into a folder."""

    out: Path
    manifest: Path
    corpus: "CorpusResult"

    @property
    def holds(self) -> bool:
        return not self.corpus.failures

    def headline(self) -> Mapping[str, str]:
        return {
            "rendered": str(self.corpus.done),
            "kept from an earlier run": str(self.corpus.kept),
            "failed": str(len(self.corpus.failures)),
        }

    def to_dict(self) -> dict[str, Any]:
        figures = picked(self.corpus, "kept", "failures", rendered="done")
        return {"out": self.out, "manifest": self.manifest, **figures, "duration_s": self.corpus.manifest["duration_s"]}

    def tables(self) -> Sequence[ResultTable | str]:
        table = ResultTable("Corpus", ("what", "files"), tuple(self.headline().items()))
        failures = (f"failed: {failure['error']}" for failure in self.corpus.failures)
        return [table, *failures, f"written: {self.out}", f"written: {self.manifest}"]


def render_corpus(
    folder: Annotated[Place, Argument("Folder of speech files, looked through to its depths.", file=True)],
    out: Annotated[Place, Option("Folder of references; what is finished there is kept.", type=Path)],
    controller: ControllerOption = None,
    *,
    display: DisplayOption = None,
    coding: Annotated[str, Option("As for `render`.")] = CODING,
    level_db_sl: Annotated[float, Option("Level of every utterance, dB SL.", ("--level",))] = LEVEL_DB_SL,
    felt: Annotated[bool, Option("Put what is felt of each file into the manifest.")] = False,
    hdf5: Annotated[bool, Option("References as .h5 in place of .wav.")] = False,
    workers: Annotated[int | None, Option("Processes (default: cores).", ge=1)] = None,
    scheduler: Annotated[str | None, Option("Address of a Dask scheduler.")] = None,
    seed: Seed = 0,
) -> RenderedCorpus:
    """Render a folder of speech files. It may be restarted, and has a manifest; exit status 1 if a file failed.

    Raises BadInput for a folder without speech, and for workers beside a scheduler.

    >>> tt.render_corpus("recordings", "rendered", controller, workers=1).headline()["failed"]
    '0'
    """
    from tactuator.corpus.corpus import MANIFEST, run_corpus
    from tactuator.corpus.workers import DaskCluster, LocalProcesses
    from tactuator.speech.coding import coding_of
    from tactuator.speech.render import RenderJob

    if workers is not None and scheduler is not None:
        raise BadInput("--workers with --scheduler", "one of them, since a cluster has its own")
    job = RenderJob(chosen_controller(display, controller), coding_of(coding), level_db_sl, felt, seed)
    cluster = nullcontext(LocalProcesses(workers)) if scheduler is None else DaskCluster(scheduler)
    target, ending = Path(out), ".h5" if hdf5 else ".wav"
    with cluster as doers, working("corpus") as step:
        corpus = run_corpus(Path(folder), target, job, doers, ending, step)
    return RenderedCorpus(target, target / MANIFEST, corpus)

"""A folder of sources to a folder of references, by workers: processes of this machine, or those of a Dask scheduler.

A reference that is whole and came from the same source by the same settings, as its head states, is kept: what was
interrupted goes on. One file's failure does not stop the others.
"""

from __future__ import annotations

import gc
import json
import logging
import os
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import islice
from multiprocessing import active_children
from pathlib import Path
from typing import Any

from tactuator.errors import BadInput, DeviceFault
from tactuator.io.atomic import check_folder
from tactuator.io.controller import parse_controller
from tactuator.io.reference import content_sha256
from tactuator.io.text import read_finite_json
from tactuator.model.controller import Controller
from tactuator.processors import begin_helper, helper_context
from tactuator.speech.render import KINDS, RenderJob, render_file, source_of

SOUNDS = (
    ".wav", ".flac", ".ogg", ".oga", ".opus", ".mp3", ".aif", ".aiff", ".aifc", ".au", ".snd", ".caf", ".w64", ".sph",
)  # fmt: skip
_AHEAD = 1000
"""Files that are handed out at once: a scheduler gets the controller with each."""
_ANSWER_S = 5.0


@dataclass(frozen=True)
class Item:
    """A source and its reference, both relative to their folders, with / between folders."""

    source: str
    out: str


@dataclass(frozen=True)
class RenderedFolder:
    """What became of a folder. files: of each reference its `source`, `out`, whether it was `kept`, and its figures.

    failures: of each source of which nothing came its `source` and the `error`. left_out: names of files that are no
    source.
    """

    files: tuple[dict[str, Any], ...]
    failures: tuple[dict[str, str], ...]
    left_out: tuple[str, ...]


def find_items(folder: Path, out: Path) -> tuple[tuple[Item, ...], tuple[str, ...]]:
    """Return every source beneath `folder`, linked folders included, and the names of the other files; both in order.

    What lies in `out` is neither, nor is a link back to a folder above. a/b.flac becomes a/b.wav; where two sources
    would become one, they keep their own endings: a/b.flac.wav. Raises BadInput where nothing can be rendered, or
    `folder` lies in `out`.
    """
    inside, sources, others = out.resolve(), list[str](), list[str]()
    if inside in (root := folder.resolve(), *root.parents):
        raise BadInput(f"{out} holds {folder}", "another folder for what is rendered")

    def unreadable(error: OSError) -> None:
        others.append(Path(error.filename).relative_to(folder).as_posix())

    above_of = {str(folder): (root, *root.parents)}
    for place, folders, names in os.walk(folder, onerror=unreadable, followlinks=True):
        above = above_of.pop(place)
        real_of = {name: Path(place, name).resolve() for name in folders}
        folders[:] = [
            name for name, real in real_of.items() if real not in above and inside not in (real, *real.parents)
        ]
        for name in folders:  # links may lead round by several folders: those passed on the way here count
            above_of[os.path.join(place, name)] = (real_of[name], *real_of[name].parents, *above)  # noqa: PTH118
        for name in names:
            path = Path(place, name).relative_to(folder)
            is_source = path.suffix.lower() in (*SOUNDS, *KINDS) and not name.startswith(".")
            (sources if is_source else others).append(path.as_posix())
    if not sources:
        raise BadInput(f"{folder} holds nothing to render", f"files ending in {', '.join((*SOUNDS, *KINDS))}")
    plain = {source: Path(source).with_suffix(".wav").as_posix() for source in sources}
    taken = Counter(plain.values())
    items = [Item(s, plain[s] if taken[plain[s]] == 1 else f"{s}.wav") for s in sorted(sources)]
    return tuple(items), tuple(sorted(others))


@contextmanager
def workers_of(count: int | None, scheduler: str | None = None) -> Iterator[Executor]:
    """Yield an executor: `count` processes of this machine (None: its cores), or the workers of a Dask scheduler at an
    address such as tcp://host:8786, which see the same files as we do. On any error its work ends.

    Raises BadInput where dask.distributed is not installed (extra `batch`) or no scheduler answers.
    """
    if scheduler is not None:
        with closing(_dask_client(scheduler)) as client:
            yield client.get_executor(pure=False)
        return
    others = set(active_children())
    pool = ProcessPoolExecutor(count or os.cpu_count(), helper_context(__name__), initializer=begin_helper)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        workers = set(active_children()) - others
        for worker in workers:
            worker.terminate()
        for worker in workers:
            worker.join()
        raise
    pool.shutdown()


def _dask_client(address: str) -> Any:
    try:
        import distributed  # noqa: PLC0415  (an extra)
    except ImportError:
        raise BadInput("dask.distributed is not installed: pip install 'tactuator[batch]'") from None
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # a line of ours says what happened
    try:
        return distributed.Client(address, timeout=_ANSWER_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        refused = type(error).__name__
    gc.collect()  # the client that failed ends here: while another one starts, it would wait for that one's lock
    raise BadInput(f"no Dask scheduler at {address!r} ({refused})", "the address of one that runs")


def render_folder(
    folder: Path,
    out: Path,
    job: RenderJob,
    workers: Executor,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> RenderedFolder:
    """Render every source beneath `folder` into `out`.

    Raises BadInput where `folder` holds nothing or `out` cannot be written, DeviceFault where a worker or the scheduler
    ends: begun again, it keeps what is done.
    """
    check_folder(out)
    items, left_out = find_items(folder, out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{out} cannot be made: {error.strerror}", "a folder that can be written") from None
    settings = {name: value for name, value in vars(job).items() if name != "controller"}
    work = partial(_render_item, folder.absolute(), out.absolute(), json.dumps(job.controller.document()), settings)
    waiting, running, outcomes = iter(items), dict[Future[dict[str, Any]], Item](), list[dict[str, Any]]()
    progress(0, len(items))
    try:
        while True:
            running |= {workers.submit(work, item): item for item in islice(waiting, _AHEAD - len(running))}
            if not running:
                break
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                outcomes.append(_outcome(future, running[future]))
                del running[future]
                progress(len(outcomes), len(items))
    except (BrokenExecutor, CancelledError, OSError):
        at_work = ", ".join(item.source for item in [*running.values()][:3])
        again = "the command again: it keeps what is done"
        raise DeviceFault(f"a worker, or the scheduler, ended at work on {at_work}", again) from None
    outcomes.sort(key=lambda outcome: str(outcome["source"]))
    files, failures = ([each for each in outcomes if ("error" in each) is failed] for failed in (False, True))
    return RenderedFolder(tuple(files), tuple(failures), left_out)


def _outcome(future: Future[dict[str, Any]], item: Item) -> dict[str, Any]:
    try:
        return future.result()
    except (BrokenExecutor, CancelledError, OSError):
        raise
    except Exception as error:  # a file on which a worker of Dask dies, say
        return {"source": item.source, "error": f"{item.source}: {type(error).__name__}"}


@lru_cache(maxsize=2)
def _controller(text: str) -> Controller:
    """Return the controller, read once in each worker: the limits derived from it are kept with it."""
    return parse_controller(json.loads(text))


def _render_item(folder: Path, out: Path, controller: str, settings: dict[str, Any], item: Item) -> dict[str, Any]:
    """Render one file, or keep what is there. Faults of the file, or of writing its reference, are in the answer."""
    source, target, job = folder / item.source, out / item.out, RenderJob(_controller(controller), **settings)
    done = {"source": item.source, "out": item.out}
    try:
        if (kept := _kept(source, target, job)) is not None:
            return {**done, "kept": True, **kept}
        target.parent.mkdir(parents=True, exist_ok=True)
        return {**done, "kept": False, **render_file(source, target, job).figures()}
    except (BadInput, OSError) as error:
        return {"source": item.source, "error": " ".join(str(error).split())}
    except SystemExit:  # a pool would hand it the next file
        os._exit(1)


def _kept(source: Path, target: Path, job: RenderJob) -> dict[str, Any] | None:
    """Return the figures of a reference that is whole and that this source and job gave, or None."""
    try:
        document = read_finite_json(target.with_suffix(".json"))
        same = source_of(source, job).items() <= document["provenance"].items()
        return dict(document["rendered"]) if same and content_sha256(target) == document["sha256"] else None
    except (BadInput, OSError, LookupError, TypeError, AttributeError):
        return None

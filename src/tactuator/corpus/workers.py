"""Workers that do the tasks: processes of this machine, or a Dask cluster. Outcomes come as they are done, in any
order.
"""

from __future__ import annotations

import gc
import logging
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Protocol

from tactuator.corpus.task import CorpusOutcome, CorpusTask, do_task, failed
from tactuator.errors import BadInput, DeviceFault
from tactuator.processors import begin_helper, helper_context

ATTEMPTS_MAX = 3
"""Number of workers that a task may lose before it counts as failed, since the task itself may kill them."""
TASKS_AHEAD = 4
"""Number of tasks handed out for every worker, so that none waits."""


class Workers(Protocol):
    """Protocol of an executor of tasks."""

    def outcomes(self, tasks: Sequence[CorpusTask]) -> Iterator[CorpusOutcome]:
        """Yield one outcome for every task, as the tasks are done."""
        ...


class Here:
    """No other process: one task after the other."""

    def outcomes(self, tasks: Sequence[CorpusTask]) -> Iterator[CorpusOutcome]:
        """Yield one outcome for every task, in order."""
        return map(do_task, tasks)


class LocalProcesses:
    """Processes of this machine, one for each core by default. A killed process is replaced and its tasks done anew."""

    def __init__(self, count: int | None = None) -> None:
        if count is not None and count < 1:
            raise BadInput(f"{count} workers", "one or more")
        self.count = (os.cpu_count() or 1) if count is None else count

    def outcomes(self, tasks: Sequence[CorpusTask]) -> Iterator[CorpusOutcome]:
        """Yield one outcome for every task, as the tasks are done."""
        lost: dict[str, int] = {}
        waiting = list(tasks)
        while waiting:
            done: set[str] = set()
            begun: list[CorpusTask] = []
            try:
                for outcome in self._pool(waiting, begun):
                    done.add(outcome.item)
                    yield outcome
            except BrokenProcessPool:
                for task in begun:
                    if task.item not in done:
                        lost[task.item] = lost.get(task.item, 0) + 1
            waiting = [task for task in waiting if task.item not in done]
            for task in [task for task in waiting if lost.get(task.item, 0) >= ATTEMPTS_MAX]:
                waiting.remove(task)
                yield failed(task, f"{task.item}: its worker died {ATTEMPTS_MAX} times; not rendered")

    def _pool(self, tasks: Sequence[CorpusTask], begun: list[CorpusTask]) -> Iterator[CorpusOutcome]:
        """Yield outcomes from one pool; `begun` ends up holding the tasks that were handed out and not done."""
        queue = iter(tasks)
        pool = ProcessPoolExecutor(self.count, helper_context("tactuator.corpus.task"), initializer=begin_helper)
        running: dict[Future[CorpusOutcome], CorpusTask] = {}
        try:
            self._hand_out(pool, queue, running, begun)
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    begun[:] = running.values()
                    outcome = future.result()
                    del running[future]
                    self._hand_out(pool, queue, running, begun)  # a worker would wait while its outcome is journalled
                    yield outcome
        finally:
            pool.shutdown(wait=False, cancel_futures=True)

    def _hand_out(
        self,
        pool: ProcessPoolExecutor,
        queue: Iterator[CorpusTask],
        running: dict[Future[CorpusOutcome], CorpusTask],
        begun: list[CorpusTask],
    ) -> None:
        """Give a task to each worker that has none; one that only waited would be blamed for a worker's death."""
        while len(running) < self.count and (task := next(queue, None)) is not None:
            running[pool.submit(do_task, task)] = task
            begun[:] = running.values()


class DaskCluster:
    """The workers of a Dask scheduler at an address such as tcp://host:8786; they see the same files as we do.

    Raises BadInput where dask.distributed is not installed (extra `batch`) or no scheduler answers within timeout_s.
    """

    def __init__(self, address: str, timeout_s: float = 5.0) -> None:
        try:
            import distributed  # noqa: PLC0415  (an extra)
        except ImportError:
            raise BadInput("dask.distributed is not installed", "pip install 'tactuator[batch]'") from None
        self._distributed = distributed
        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # what happens is told in a line of ours
        self._address = address
        refused = ""
        try:
            self._client = distributed.Client(address, timeout=timeout_s, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            refused = type(error).__name__
        if refused:
            # the client that failed ends here: collected while another one starts, it would wait for that one's lock
            gc.collect()
            raise BadInput(f"no Dask scheduler at {address!r} ({refused})", "the address of one that runs")

    def outcomes(self, tasks: Sequence[CorpusTask]) -> Iterator[CorpusOutcome]:
        """Yield one outcome for every task, as the tasks are done; the scheduler gives a killed worker's tasks to
        others. Raises DeviceFault where the scheduler itself ends.
        """
        try:
            yield from self._outcomes(tasks)
        except (self._distributed.client.FutureCancelledError, CancelledError, OSError):
            raise DeviceFault(
                f"the Dask scheduler at {self._address!r} has ended", "the command again; it keeps what is done"
            ) from None

    def _outcomes(self, tasks: Sequence[CorpusTask]) -> Iterator[CorpusOutcome]:
        names = {}
        queue, ahead = iter(tasks), self._distributed.as_completed(loop=self._client.loop)
        for task in self._first(queue):
            names[self._submit(ahead, task)] = task
        for future in ahead:
            task = names.pop(future.key)
            error = future.exception() if future.status == "error" else None
            if error is None:
                yield future.result()
            else:
                yield failed(task, f"{task.item}: {type(error).__name__}; not rendered")
            following = next(queue, None)
            if following is not None:
                names[self._submit(ahead, following)] = following

    def _first(self, queue: Iterator[CorpusTask]) -> Iterator[CorpusTask]:
        count = max(1, sum(self._client.nthreads().values())) * TASKS_AHEAD
        for _, task in zip(range(count), queue, strict=False):
            yield task

    def _submit(self, ahead: object, task: CorpusTask) -> str:
        future = self._client.submit(do_task, task, pure=False)
        ahead.add(future)  # type: ignore[attr-defined]
        return str(future.key)

    def close(self) -> None:
        """Leave the cluster; what was not begun is given up."""
        self._client.close()

    def __enter__(self) -> DaskCluster:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

"""Calls of PortAudio: one after another, in a thread of their own, and none is waited for without end.

PortAudio waits for its host without a limit, or for ten minutes: a driver that hangs, or a server that has stopped,
would hold the whole program. The calls have one thread because some hosts (WASAPI, ASIO) want all of them from the
same one.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any, TypeVar

from tactuator.errors import DeviceFault

ANSWER_S = 20.0
"""A call that takes longer has failed. A card that is far away (Bluetooth) takes some seconds to open."""

_T = TypeVar("_T")


class AudioThread:
    """Calls in a thread of its own, which begins with the first one. After one that did not come back, each fails."""

    def __init__(self) -> None:
        self._calls: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._hung = ""

    def answer(self, job: Callable[[], _T], what: str, undo: Callable[[_T], object] | None = None) -> _T:
        """Return what `job` returns, or raise what it raises. what: the job in words, for the error.

        undo: called with the result where nobody waits for it any more. Raises DeviceFault after ANSWER_S.
        """
        if self._hung:
            raise DeviceFault(self._hung)
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="audio", daemon=True)
            self._thread.start()
        future: Future[_T] = Future()
        self._calls.put((job, future))
        try:
            wait([future], timeout=ANSWER_S)
        except BaseException:
            _undo_when_done(future, undo)
            raise
        if future.done():
            return future.result()
        _undo_when_done(future, undo)
        self._hung = (
            f"{what}: the sound system has not answered for {ANSWER_S:g} s; "
            "allowed: one whose driver and server answer, in a program begun anew"
        )
        raise DeviceFault(self._hung)

    def _work(self) -> None:
        while True:
            job, future = self._calls.get()
            try:
                future.set_result(job())
            except BaseException as error:
                future.set_exception(error)


def _undo_when_done(future: Future[_T], undo: Callable[[_T], object] | None) -> None:
    def undone(done: Future[_T]) -> None:
        if undo is not None and done.exception() is None:
            undo(done.result())

    future.add_done_callback(undone)

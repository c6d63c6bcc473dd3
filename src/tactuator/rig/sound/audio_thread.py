"""Calls of PortAudio: one after another, in a thread of their own, and none is waited for without end.

PortAudio waits for its host without a limit, or for ten minutes: a driver that hangs, or a server that has stopped,
would hold the whole program. Where a server dies while it is talked to, PortAudio calls abort, which would end the
program without a word: then this thread alone is stopped. The calls have one thread because some hosts (WASAPI, ASIO)
want all of them from the same one.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any, TypeVar

from tactuator.errors import DeviceFault
from tactuator.runtime._core import ffi, lib

ANSWER_S = 20.0
"""A call that takes longer has failed. A card that is far away (Bluetooth) takes some seconds to open."""
LOOK_S = 0.05
"""Pause between two looks at whether the library has given up."""

_T = TypeVar("_T")


class AudioThread:
    """Calls in a thread of its own, which begins with the first one. After one that did not come back, each fails.

    lost: a call did not come back, or whoever is called has gone: the program ends without ending what is called.
    """

    def __init__(self) -> None:
        self._calls: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._parked = ffi.new("int *")
        self._hung = ""
        self.lost = False

    def answer(self, job: Callable[[], _T], what: str, undo: Callable[[_T], object] | None = None) -> _T:
        """Return what `job` returns, or raise what it raises. what: the job in words, for the error.

        undo: called with the result where nobody waits for it any more. Raises DeviceFault after ANSWER_S, and where
        the library has called abort.
        """
        if self._hung:
            raise DeviceFault(self._hung)
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="audio", daemon=True)
            self._thread.start()
        future: Future[_T] = Future()
        self._calls.put((job, future))
        try:
            self._wait(future)
        except BaseException:
            _undo_when_done(future, undo)
            raise
        if future.done():
            return future.result()
        _undo_when_done(future, undo)
        self.lost = True
        self._hung = (
            f"{what}: {self._complaint()}; allowed: one whose driver and server answer, in a program begun anew"
        )
        raise DeviceFault(self._hung)

    def _wait(self, future: Future[Any]) -> None:
        until = time.monotonic() + ANSWER_S
        while not future.done() and not lib.tact_parking_taken(self._parked):
            left_s = until - time.monotonic()
            if left_s <= 0.0:
                return
            wait([future], timeout=min(LOOK_S, left_s))

    def _complaint(self) -> str:
        if lib.tact_parking_taken(self._parked):
            return "the sound system has failed, as it does where its server ends"
        return f"the sound system has not answered for {ANSWER_S:g} s"

    def _work(self) -> None:
        while True:
            job, future = self._calls.get()
            lib.tact_parking_begin(self._parked)
            try:
                future.set_result(job())
            except BaseException as error:
                future.set_exception(error)
            finally:
                lib.tact_parking_end()


def _undo_when_done(future: Future[_T], undo: Callable[[_T], object] | None) -> None:
    def undone(done: Future[_T]) -> None:
        if undo is not None and done.exception() is None:
            undo(done.result())

    future.add_done_callback(undone)

"""Orders that wait for the rig: so many at most, and what ends something is never kept waiting behind them."""

from __future__ import annotations

import queue

from tactuator.console.held_rig import orders

WAITING_MAX = 1000
"""Orders that may wait, while a measurement goes on for instance; a page makes less than a hundred a second."""


class WaitingOrders:
    """Orders in turn, put in by other threads than the one that obeys them."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[orders.Order] = queue.SimpleQueue()

    def put(self, order: orders.Order) -> str:
        """Let an order wait its turn, and return what is to be told of it; empty as a rule.

        Where too many wait, another is refused. An order to end something takes the place of those before it instead,
        and one that an experiment waits for is taken in any case.
        """
        told = ""
        if self._queue.qsize() >= WAITING_MAX and not _is_awaited(order):
            if not _ends(order):
                return f"{WAITING_MAX} orders wait for the rig; allowed: another once they are done"
            told = f"{self._forget()} orders that waited for the rig are dropped, because something is to end"
        self._queue.put(order)
        return told

    def get(self) -> orders.Order:
        """Return the next order, as soon as there is one."""
        return self._queue.get()

    def get_nowait(self) -> orders.Order | None:
        """Return the next order, or None where none waits."""
        try:
            return self._queue.get_nowait()
        except queue.Empty:
            return None

    def _forget(self) -> int:
        """Drop what waits, but for what an experiment waits for; return how many orders that were."""
        waited = []
        while (order := self.get_nowait()) is not None:
            waited.append(order)
        kept = [order for order in waited if _is_awaited(order)]
        for order in kept:
            self._queue.put(order)
        return len(waited) - len(kept)


def _is_awaited(order: orders.Order) -> bool:
    """Return whether an experiment waits for the order's end, or the process ends with it."""
    return isinstance(order, orders.PresentOrder | orders.QuitOrder) or (
        isinstance(order, orders.RestOrder) and order.number != 0
    )


def _ends(order: orders.Order) -> bool:
    return isinstance(order, orders.RestOrder) or (isinstance(order, orders.GenerateOrder) and order.wave is None)

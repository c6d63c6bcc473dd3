"""Orders that wait for the rig while it measures: a page that floods it takes no memory, and can be stopped."""

import numpy as np
import pytest

from tactuator.console.held_rig import orders
from tactuator.console.held_rig.waiting import WAITING_MAX, WaitingOrders
from tactuator.console.held_rig.worker import RigWorker

PRESS = orders.PressOrder("index", 0.1)
PRESENT = orders.PresentOrder(3, (np.zeros((1, 3)),))


def flooded() -> WaitingOrders:
    made = WaitingOrders()
    assert [made.put(PRESS) for _ in range(WAITING_MAX)] == [""] * WAITING_MAX
    return made


def rest_of(waiting: WaitingOrders) -> list[orders.Order]:
    return list(iter(waiting.get_nowait, None))


@pytest.mark.parametrize("order", [PRESS, orders.LiveOrder(), orders.TouchOrder("index", None)])
def test_orders__beyond_the_limit__are_refused_in_words(order) -> None:
    waiting = flooded()
    assert "allowed" in waiting.put(order)
    assert rest_of(waiting) == [PRESS] * WAITING_MAX
    assert waiting.put(order) == ""


@pytest.mark.parametrize("end", [orders.RestOrder(), orders.GenerateOrder(None)])
def test_end__behind_too_many_orders__takes_their_place(end) -> None:
    waiting = flooded()
    assert f"{WAITING_MAX} orders" in waiting.put(end)
    assert rest_of(waiting) == [end]


@pytest.mark.parametrize("order", [PRESENT, orders.RestOrder(2), orders.QuitOrder()])
def test_order__that_somebody_waits_for__is_taken_and_outlives_an_end(order) -> None:
    waiting = flooded()
    assert waiting.put(order) == ""
    assert waiting.put(orders.RestOrder())
    assert rest_of(waiting) == [order, orders.RestOrder()]


def test_worker__with_too_many_orders__tells_the_page(controller) -> None:
    told: list[orders.Told] = []
    worker = RigWorker("simulated", controller.display, 1, told.append)
    for _ in range(WAITING_MAX + 3):
        worker.order(PRESS)
    assert [type(one) for one in told] == [orders.Refused] * 3

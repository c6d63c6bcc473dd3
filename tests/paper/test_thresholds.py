"""Observers in processes of their own."""

import multiprocessing
from multiprocessing.connection import wait

import pytest

from tactuator.paper.plan import Plan, paper_display
from tactuator.paper.steps import paper_controller
from tactuator.paper.thresholds import observers_at_work


def test_observers_at_work__interrupted__their_processes_end() -> None:
    plan, others = Plan(paper_display()), set(multiprocessing.active_children())
    with pytest.raises(KeyboardInterrupt), observers_at_work(plan, paper_controller(plan.display)):
        workers = set(multiprocessing.active_children()) - others
        raise KeyboardInterrupt
    assert len(workers) == 3
    assert all(wait([worker.sentinel], 5.0) for worker in workers)

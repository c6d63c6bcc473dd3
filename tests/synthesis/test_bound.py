"""Delivered loops judged from outside, and the bound that none may beat."""

from __future__ import annotations

import numpy as np
import pytest

from tactuator.model.requirements import FeedbackRequirements
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.bound import _Program, bound_db
from tactuator.synthesis.family import plant_family
from tactuator.synthesis.loop_synthesis import synthesise
from tactuator.synthesis.screening import Task
from tests.synthesis.displays import channel
from witnesses.loops.search import Judge, delivered, drawn, named

MOST_DB = {
    "LRA 175 Hz Q 15": (-72.5, -93.5),
    "voice coil": (-56.4, -75.6),
    "piezo 250 Hz Q 50": (-74.5, -95.0),
    "3 ms of dead time": (-25.8, -36.6),
    "90/80 Hz pair": (-38.3, -61.4),
    "drawn 14: no spring": (-40.7, -59.5),
    "drawn 15: with a mode": (-23.0, -41.7),
    "drawn 25: motor": (-41.4, -59.5),
}
"""What a search from outside knows at best (witnesses.loops.search), less 1 dB; and what the bound lies above."""
PLANTS = {plant.name: plant for plant in [*named(), *drawn(26)]}


SLOW = ("90/80 Hz pair", "drawn 14: no spring", "drawn 25: motor")
MARKS = dict.fromkeys(SLOW, pytest.mark.slow) | {"drawn 15: with a mode": pytest.mark.soak}  # the pair has one as well


@pytest.mark.parametrize("name", [pytest.param(name, marks=MARKS.get(name, ())) for name in MOST_DB])
def test_synthesise__plants_of_the_list__limits_kept_and_within_1_db_of_the_best_known(name) -> None:
    zeros, poles, gain, _, bound = delivered(PLANTS[name])
    judge = Judge(PLANTS[name])
    mean, excess = judge.figures(zeros, poles, gain)
    assert excess < 2e-3
    assert judge.is_stable(zeros, poles, gain)
    assert mean <= MOST_DB[name][0]
    assert bound is not None
    assert MOST_DB[name][1] < bound < mean
    assert judge.figures(zeros, poles, 2.0 * gain)[1] > 0.02


def test_bound__phase_of_a_delivered_loop__is_what_its_level_says() -> None:
    """The program's matrix gives the angle of S from its level: on a loop that it has never seen."""
    asked = FeedbackRequirements()
    one = channel(plant=ContinuousSystem.from_polynomials([35530.0], [1.0, 113.0, 35530.0]), loads=(), feedback=asked)
    task = Task.of(plant_family(one, 8000.0, 1), asked, 8000.0, 1.3)
    program = _Program(task, task.family[0], 300)
    response = FeedbackLoop(next(synthesise(task))[1], task.family[0].sampled).sensitivity(program._hz)
    told = program._turn @ np.log(np.abs(response))
    assert np.degrees(np.abs(told - np.unwrap(np.angle(response))))[5:-5].max() < 1.0
    nothing = np.abs(program._analytic() @ np.log(np.abs(response)))
    assert nothing.max() < 1e-3


def test_bound__unstable_plant__none() -> None:
    asked = FeedbackRequirements()
    one = channel(plant=ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, -290.0]), loads=(), feedback=asked)
    assert bound_db(Task.of(plant_family(one, 8000.0, 1), asked, 8000.0, 1.3)) is None

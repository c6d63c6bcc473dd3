"""A simulated apparatus, a clock that obeys, and protocols that end soon."""

from contextlib import closing
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

from sqlalchemy import select

from tactuator.api.parameters import paper_controller, paper_display
from tactuator.experiment.protocol.file import Protocol, parse_protocol
from tactuator.experiment.session.session import Session
from tactuator.experiment.session.studies import Study, open_session, open_study
from tactuator.experiment.session.task import Apparatus
from tactuator.experiment.session.tone_task import DetectionTask
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import Answer
from tactuator.experiment.store.store import Store
from tactuator.experiment.trial import Trial
from tactuator.experiment.words import shipped_words
from tactuator.model.controller import Controller
from tactuator.rig.simulated import SimulatedRig

PROTOCOL = """
[study]
name = "short"
seed = 7
experimenter = "EX"
consent = "You may stop at any time."
[procedure]
kind = "up-down"
start_db_sl = 20
steps_db = [4, 2]
reversals = 6
averaged = 4
[conditions]
fingers = ["index"]
frequencies_hz = [30, 90, 210]
order = "latin-square"
[circumstances]
contact_area_mm2 = 78.5
skin_temperature_c = 31
masking_sound = "pink"
[timing]
stimulus_s = 0.05
ramp_s = 0.01
gap_s = 0.01
lead_s = 0.01
feedback_s = 0.0
[session]
practice_trials = 2
break_after_trials = 20
resume_within_s = 600
[[subject]]
code = "S1"
group = "hearing"
[[subject]]
code = "S2"
group = "hearing-impaired"
"""


class ObedientClock:
    """Goes only where it is told."""

    def __init__(self) -> None:
        self.now = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)
        self.passed_s = 100.0

    def utc(self) -> datetime:
        return self.now

    def monotonic_s(self) -> float:
        return self.passed_s

    def wait(self, seconds: float) -> None:
        self.now += timedelta(seconds=seconds)
        self.passed_s += seconds

    def jump(self, seconds: float) -> None:
        self.now += timedelta(seconds=seconds)


@cache
def controller() -> Controller:
    return paper_controller(paper_display())


def apparatus(seed: int = 0) -> Apparatus:
    rig = SimulatedRig(controller().display, seed)
    rig.load(controller())
    return Apparatus(rig, controller(), "simulated")


def begin(store: Store, clock: ObedientClock, text: str = PROTOCOL, subject: int = 0, trials: int = 0) -> Session:
    """The subject's session, opened or resumed, consent given, and so many trials answered."""
    study = opened_study(store, clock, text)
    session = open_session(study, study.task.protocol.subject[subject].code)
    if session.stage == "consent":
        session.give_consent()
    presented = session
    for _ in range(trials):
        answer_one(presented, clock)
    return presented


def opened_study(store: Store, clock: ObedientClock, text: str = PROTOCOL, amend: str | None = None) -> Study:
    protocol = parse_protocol(text, Protocol)
    task = DetectionTask(protocol, apparatus(), words=shipped_words(protocol.study.language))
    return open_study(store, task, text, clock, token, amend)


def rows_of(store: Store, query) -> list:
    with store.read() as connection:
        return connection.execute(query).all()


def answers(place: str | Path) -> list[tuple[Any, ...]]:
    """Every answer of a store: subject, position of the run, number, and what was presented and answered."""
    run, trial, response = schema.run, schema.trial, schema.response
    query = select(
        schema.subject.c.code, run.c.position, trial.c.number, run.c.attempt, trial.c.level_db_sl,
        trial.c.correct_response, trial.c.presented_utc, response.c.response, response.c.server_received_utc,
    ).select_from(schema.ANSWERED)  # fmt: skip
    with closing(Store(place)) as store:
        return [tuple(row) for row in rows_of(store, query)]


def token(code: str, visit: int) -> str:
    return f"token-{code}" if visit == 1 else f"token-{code}-{visit}"


def nobody(interval: int, begins: bool) -> None:
    """Watches nothing."""


def response_of(trial: Trial) -> str:
    """What the scripted subject answers: right, but for every fourth trial, whatever happened in between."""
    if trial.number % 4 != 3:
        return trial.correct
    return next(one for one in trial.responses if one != trial.correct)


def answer_one(presented: Session, clock: ObedientClock) -> tuple[int, int]:
    """Present and answer the trial that stands; position of its run and its number."""
    following = presented.present(nobody)
    position, number = following.planned.position, following.trial.number
    clock.wait(1.0)
    presented.answer(Answer(response_of(following.trial), clock.utc(), 10.0, 460.0))
    return position, number


def everything(presented: Session, clock: ObedientClock, answer=answer_one) -> None:
    while presented.stage != "done":
        if presented.stage == "break":
            presented.end_break()
        answer(presented, clock)

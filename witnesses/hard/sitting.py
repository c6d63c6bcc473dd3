"""Subjects who answer at random into a store, in a process of their own that somebody ends at a random moment.

What the store has must be what this process told through its pipe, answer for answer. The reader of the store here is
SQLite's own Python module with one query; nothing of tactuator's reading stands between.
"""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path

from tactuator.api.parameters import paper_controller, paper_display
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.session.presented_session import PresentedSession
from tactuator.experiment.session.studies import open_session, open_study
from tactuator.experiment.session.task import Apparatus
from tactuator.experiment.store.records import Answer
from tactuator.experiment.store.store import Store
from tactuator.model.controller import Controller
from tactuator.rig.simulated import SimulatedRig

CODES = [f"S{number}" for number in range(1, 61)]
_ANSWERS = """
SELECT subject.code, run.position, trial.number, response.response FROM response
JOIN trial ON trial.id = response.trial_id JOIN run ON run.id = trial.run_id
JOIN session ON session.id = run.session_id JOIN subject ON subject.id = session.subject_id
"""

Row = tuple[str, int, int, str]


def protocol(reversals: int, codes: Sequence[str]) -> str:
    """Return a protocol of short stimuli for the subjects of those codes, three runs each."""
    return f"""
[study]
name = "sitting"
seed = 7
experimenter = "EX"
consent = "You may stop at any time."
[procedure]
kind = "up-down"
start_db_sl = 20
steps_db = [4, 2]
reversals = {reversals}
averaged = 2
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
practice_trials = 0
break_after_trials = 100000
resume_within_s = 86400
""" + "".join(f'[[subject]]\ncode = "{code}"\n' for code in codes)


_LONG = protocol(400, CODES)


@cache
def _controller() -> Controller:
    return paper_controller(paper_display())


class _Clock:
    """Begins `hours` after the study's first day, and goes where it is told."""

    def __init__(self, hours: int) -> None:
        self._now = datetime(2026, 3, 1, tzinfo=UTC) + timedelta(hours=hours)
        self._passed_s = 100.0

    def utc(self) -> datetime:
        return self._now

    def monotonic_s(self) -> float:
        return self._passed_s

    def wait(self, seconds: float) -> None:
        self._now += timedelta(seconds=seconds)
        self._passed_s += seconds


@dataclass(frozen=True)
class Broken:
    """How the sitting is broken on purpose. early: an answer is told before it is stored; careless: SQLite does not
    wait for the disk; deaf: every hundredth answer is stored as another one.
    """

    early: bool = False
    careless: bool = False
    deaf: bool = False


def warm() -> None:
    """Make the controller, so that a fork has it."""
    _controller()


@dataclass
class Sittings:
    """A store, and what was told of it: subject, position of the run, number of the trial, response."""

    store: Path
    seed: int
    broken: Broken
    told: list[Row]
    begun: int = 0

    def until_killed(self, answers: int, wait_s: float, prepare: Callable[[], None] = lambda: None) -> None:
        """Let subjects answer in a child, and kill it wait_s after so many answers; prepare: called in the child."""
        self.begun += 1
        reads, writes = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reads)
            prepare()
            _answer(self.store, self.seed, self.begun, self.broken, writes)
        os.close(writes)
        content = b""
        while content.count(b"\n") < answers:
            piece = os.read(reads, 65536)
            if not piece:
                break
            content += piece
        time.sleep(wait_s)
        os.kill(child, signal.SIGKILL)
        while piece := os.read(reads, 65536):
            content += piece
        os.close(reads)
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            raise SystemExit("the sitting ended by itself: see above")
        for line in content.decode().split("\n")[:-1]:
            code, position, number, response = line.split()
            self.told.append((code, int(position), int(number), response))

    def faults(self) -> dict[str, int]:
        """Return how many told answers the store has lost or changed, how many it has doubled, and how many it has that
        were never told beyond the one that each end may have cut off.
        """
        stored, damaged = self._stored()
        there = {row[:3]: row[3] for row in stored}
        told = {row[:3]: row[3] for row in self.told}
        return {
            "lost": sum(key not in there for key in told),
            "changed": sum(there.get(key, response) != response for key, response in told.items()),
            "doubled": len(stored) - len(there) + len(self.told) - len(told),
            "untold": max(0, len(there) - len(told) - self.begun),
            "damaged": damaged,
        }

    def _stored(self) -> tuple[list[Row], int]:
        """Return the answers that the store has, and how many faults SQLite finds in it."""
        try:
            with closing(sqlite3.connect(self.store)) as connection:
                there = connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'response'").fetchone()
                stored: list[Row] = list(connection.execute(_ANSWERS)) if there else []
                sound = connection.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
                return stored, int(not sound) + len(connection.execute("PRAGMA foreign_key_check").fetchall())
        except sqlite3.DatabaseError as error:
            sys.stderr.write(f"{error}\n")
            return [], 1


def _answer(store: Path, seed: int, hours: int, broken: Broken, pipe: int) -> None:
    """Answer until killed; never returns."""
    try:
        told = _told(store, seed, hours, broken)
        for line in told:
            os.write(pipe, line)
        sys.stderr.write("all sessions are over\n")
    except BaseException as error:
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
    finally:
        os._exit(1)


def _told(path: Path, seed: int, hours: int, broken: Broken) -> Iterator[bytes]:
    clock, store = _Clock(hours), Store(path, durable=not broken.careless)
    rig = SimulatedRig(_controller().display, seed)
    rig.load(_controller())
    task = DetectionTask(parse_protocol(_LONG, Protocol), Apparatus(rig, _controller(), "simulated"))
    study = open_study(store, task, _LONG, clock, lambda code, visit: f"token-{code}-{visit}", None)
    for code in CODES:
        session = open_session(study, code)
        if session.stage == "consent":
            session.give_consent()
        presented = PresentedSession(session)
        while session.stage != "done":
            following = presented.present(lambda interval, begins: None)
            position, number = following.planned.position, following.trial.number
            rng = random.Random(f"{seed}/{code}/{position}/{number}")
            response = rng.choice(following.trial.responses)
            line = f"{code} {position} {number} {response}\n".encode()
            if broken.early:
                yield line
            clock.wait(1.0)
            if broken.deaf and rng.random() < 0.01:
                response = next(one for one in following.trial.responses if one != response)
            presented.answer(Answer(response, clock.utc(), 10.0, 460.0))
            if not broken.early:
                yield line

"""Tasks of a session, be it detection or recognition: what they ask and show, their apparatus and their clock."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from sqlalchemy import Connection

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.presenter import Outlet, Watch
from tactuator.experiment.procedure.procedure import Playable
from tactuator.experiment.protocol.study import ALL_FINGERS, PlannedRun, RunRules, StudyProtocol
from tactuator.experiment.store.records import PlayedTrial
from tactuator.experiment.store.store import Store
from tactuator.experiment.task.task import TaskState
from tactuator.experiment.trial import Timing, Trial
from tactuator.experiment.words import Words, shipped_words
from tactuator.measure.error import ChannelPrediction
from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.result import ResultTable
from tactuator.rig.rig import Rig
from tactuator.synthesis.design import headroom


class Clock(Protocol):
    """A clock: `utc` for records, `monotonic_s` for durations within one process."""

    def utc(self) -> datetime:
        """Return the present time with its time zone."""

    def monotonic_s(self) -> float:
        """Return seconds that only go forward."""


class SystemClock:
    """The clock of the machine."""

    def utc(self) -> datetime:
        """Return the present time in UTC."""
        return datetime.now(UTC)

    def monotonic_s(self) -> float:
        """Return the seconds since some start."""
        return time.monotonic()


_JUMP_S = 2.0


class JumpWatch:
    """Detector of jumps of the wall clock, relative to the monotonic one."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._utc, self._monotonic_s = clock.utc(), clock.monotonic_s()

    def jump_s(self) -> float | None:
        """Return how far the wall clock has jumped since the last call (forward positive), or None."""
        utc, monotonic_s = self._clock.utc(), self._clock.monotonic_s()
        jump = (utc - self._utc).total_seconds() - (monotonic_s - self._monotonic_s)
        self._utc, self._monotonic_s = utc, monotonic_s
        return jump if abs(jump) > _JUMP_S else None


@dataclass(frozen=True)
class Apparatus:
    """A rig with a controller loaded, and its name. outlet: where others in the room hear what is played."""

    rig: Rig
    controller: Controller
    name: str
    outlet: Outlet | None = None

    def channel(self, finger: str) -> Channel:
        """Return the channel for that finger (the first for all of them). Raises BadInput if the display has none."""
        for channel in self.controller.display.channels:
            if finger in (channel.finger, ALL_FINGERS):
                return channel
        fingers = ", ".join(channel.finger for channel in self.controller.display.channels)
        raise BadInput(f"finger {finger!r} is not on the display", f"{fingers}")

    def column(self, finger: str) -> int:
        """Return the place of that finger's channel among those of the rig. Raises BadInput as `channel` does."""
        return self.rig.channels.index(self.channel(finger).name)

    def record(self, finger: str) -> dict[str, object]:
        """Return the columns of a run on that finger that describe the apparatus.

        rig_simulated: True where nothing can be felt. speed: of presentation, 1 being real time, None as fast as the
        rig can.
        """
        channel, (low_hz, high_hz) = self.channel(finger), self.band_hz
        return {
            "rig": self.name,
            "display": self.controller.display.name,
            "controller_sha256": self.controller.content_hash,
            "curve": channel.threshold.curve.name,
            "curve_sha256": channel.threshold.curve.content_hash,
            "sensor_gain_v_per_mm": channel.sensor_gain_v_per_mm,
            "band_low_hz": low_hz,
            "band_high_hz": high_hz,
            "rig_simulated": self.simulated,
            "rig_rate_hz": self.rig.rate_hz,
            "speed": self.rig.speed,
        }

    def playable(self, timing: Timing) -> Playable:
        """Return the range of stimuli of that timing that a procedure which chooses frequencies may use."""
        mains_hz = self.controller.display.channels[0].environment.mains_hz
        return Playable(self.band_hz, mains_hz, timing.clearance_hz(mains_hz or 100.0))

    def highest_db_sl(self, finger: str, frequency_hz: float) -> float:
        """Return the highest level of a tone that the display plays on that finger, nobody touching it."""
        channel = self.channel(finger)
        loop = ChannelPrediction.of(self.controller, channel.name).loop
        room = headroom(channel, loop, np.array([frequency_hz]), COMFORT_DB_SL)
        return float(
            room.before(self.controller.channel(channel.name).strength, self.controller.rate_hz).level_db_sl[0]
        )

    @property
    def simulated(self) -> bool:
        """Return whether the display is simulated, so that nobody can feel anything there."""
        return self.rig.has_finger_ports

    @property
    def band_hz(self) -> tuple[float, float]:
        """Return the band of the display's first channel."""
        return self.controller.display.channels[0].threshold.band_hz

    @property
    def middle_hz(self) -> float:
        """Return the middle of the band, where a run that chooses its frequencies is on the whole."""
        return math.sqrt(math.prod(self.band_hz))


@dataclass(frozen=True)
class OfferedResponse:
    """A response as it is offered.

    keys: characters any of which gives it. label: what it says, by default the response.
    codes: physical keys that give it whatever the layout puts there
    (KeyboardEvent.code).
    """

    response: str
    keys: tuple[str, ...]
    label: str = ""
    codes: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "label", self.label or self.response)
        object.__setattr__(self, "codes", _key_codes(self.keys))


def _key_codes(keys: Sequence[str]) -> tuple[str, ...]:
    """Return the physical keys that are meant by digits: those of the upper row and of the number pad.

    They are there on every layout, though an unshifted AZERTY key types another character. Letters are where the
    layout has them.
    """
    return tuple(f"{row}{key}" for key in keys if len(key) == 1 and key in "0123456789" for row in ("Digit", "Numpad"))


@dataclass(frozen=True)
class Envelope:
    """Envelope of an interval, for a demonstration.

    envelope_db_sl: a value every step_s, dB SL. frequency_hz: None where the interval has no single one.
    """

    STEP_S: ClassVar[float] = 0.02
    SILENT_DB_SL: ClassVar[float] = -60.0

    envelope_db_sl: tuple[float, ...]
    step_s: float
    frequency_hz: float | None = None

    @classmethod
    def of(cls, levels_db_sl: FloatArray, frequency_hz: float | None = None) -> Envelope:
        """Return the envelope of levels at every STEP_S, rounded to 0.1 dB."""
        return cls(tuple(np.round(levels_db_sl, 1).tolist()), cls.STEP_S, frequency_hz)


@dataclass(frozen=True)
class Question:
    """The question of every trial, which is the same in all of them, so it cannot give the answer away.

    choices: none where a number is asked for.
    intervals: names of those that are shown as they play; none if the subject must not distinguish them.
    """

    prompt: str
    choices: tuple[OfferedResponse, ...]
    intervals: tuple[str, ...] = ()


@dataclass(frozen=True)
class Rules:
    """Rules of a session's breaks, the duration of feedback, and the longest interruption of a run.

    break_s: the least duration of a break.
    """

    feedback_s: float
    break_after_trials: int | None = None
    break_between_runs: bool = False
    break_s: float = 0.0
    resume_within_s: float = math.inf

    @classmethod
    def of(cls, rules: RunRules, feedback_s: float) -> Rules:
        """Return those of a protocol's table [session]."""
        return cls(feedback_s, rules.break_after_trials, rules.break_between_runs, rules.break_s, rules.resume_within_s)


@dataclass(frozen=True)
class NextTrial:
    """The trial to present next; run: its row in the store; seed: of the run."""

    run: int
    planned: PlannedRun
    trial: Trial
    seed: tuple[int, ...]


@dataclass(frozen=True)
class SessionTask:
    """The task of a session: a protocol at an apparatus, in the words of the study's language."""

    protocol: StudyProtocol
    apparatus: Apparatus
    words: Words = field(default_factory=lambda: shipped_words("en"))

    @property
    def question(self) -> Question:
        """The question that subjects see."""
        raise NotImplementedError

    @property
    def rules(self) -> Rules:
        """The rules of a session."""
        raise NotImplementedError

    def faults(self) -> Iterator[BadInput]:
        """Yield every reason why nobody's runs can come to a result on this apparatus."""
        yield from self.protocol.faults()
        rules, longest = self.rules, max((run.typical_trials for run in self.runs(0)), default=0.0)
        if rules.break_s > rules.resume_within_s and (rules.break_after_trials or math.inf) < longest:
            got = f"{rules.break_s:g}, within runs that begin again after {rules.resume_within_s:g} s without an answer"
            yield BadInput(got, f"{rules.resume_within_s:g} or less", key="session.break_s")

    def enrol(self, connection: Connection, study: int) -> None:
        """Store what a new study has besides its sessions. Raises BadInput where it is there with something else."""

    @classmethod
    def load(cls, protocol: Any, beside: Path, apparatus: Apparatus, words: Words | None = None) -> Self:
        """Return the task of the protocol, whose files lie in `beside`."""
        return cls(protocol, apparatus, words or shipped_words("en"))

    def runs(self, subject: int, visit: int = 1) -> tuple[PlannedRun, ...]:
        """Return every run of a visit (from 1) of a subject (from 0), which are the same after any interruption."""
        return self.protocol.runs(subject, visit, self.words)

    def begin(self, planned: PlannedRun, subject: int, visit: int = 1, attempt: int = 0) -> TaskState:
        """Return the state of a planned run at its beginning."""
        raise NotImplementedError

    def play(self, following: NextTrial, watch: Watch, halted: Callable[[], bool], presented: datetime) -> PlayedTrial:
        """Play a trial.

        watch: called at its intervals. halted: asked whether it is to end at once. presented: the present time. Raises
        Halted where it was stopped while it played.
        """
        raise NotImplementedError

    def envelope(self, trial: Trial, interval: int) -> Envelope:
        """Return the envelope of what the interval plays."""
        raise NotImplementedError

    def expected(self, planned: PlannedRun) -> tuple[float, float]:
        """Return the approximate number of trials of a run, and how many seconds one of them plays."""
        raise NotImplementedError

    def results(self, store: Store, session: int) -> tuple[ResultTable, ...]:
        """Return the results of the session's answers so far. Raises BadInput while there are none."""
        raise NotImplementedError

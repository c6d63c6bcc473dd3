"""Tasks whose trials play tones: detection, and any of `tactuator.tasks`."""

from __future__ import annotations

import itertools
import math
import typing
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
from sqlalchemy import Connection, select

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.presenter import PlayedInterval, Presenter, Watch, amplitude
from tactuator.experiment.procedure.procedure import PEOPLE_DB, Playable
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.protocol.judging import JudgingProtocol
from tactuator.experiment.protocol.study import PlannedRun
from tactuator.experiment.result.confusion import threshold_table
from tactuator.experiment.result.thresholds import thresholds
from tactuator.experiment.session.task import Envelope, NextTrial, OfferedResponse, Question, Rules, SessionTask
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import PlayedTrial
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import answered_runs, detection_runs
from tactuator.experiment.task.task import Place, ProcedureState, TaskState
from tactuator.experiment.trial import BLANK, LOUD, SIGNAL, IntervalRecord, Timing, Tone, Trial, trial_rng
from tactuator.measure.error import reading_doubt_db
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.result import ResultTable
from tactuator.signals.decibels import db, from_db
from tactuator.signals.excitation import ramps
from tactuator.signals.excitation import tone as tone_wave
from tactuator.signals.spectra import nearest_mains

_LEAST_PEAK_V, _HIDDEN_DB = 1e-12, 1.0
"""Least peak that is reported, and what the A/D's steps may change of a reading that is reported."""
_LEAST_RISE = 1e-3
"""Start of a drawn ramp, 60 dB below the tone."""


class Listener(typing.Protocol):
    """A simulated person; levels are those of the intervals as felt, (m,), dB re 1 um peak."""

    def respond(self, felt_db_re_1um: FloatArray, frequency_hz: float, rng: np.random.Generator) -> int:
        """Return the index of the interval in which something was felt."""

    def judge(self, felt_db_re_1um: FloatArray, frequency_hz: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return how strong each interval feels, dB SL of the person's own curve."""


@dataclass(frozen=True)
class ToneTask(SessionTask):
    """A protocol whose trials play tones, at an apparatus.

    Raises BadInput for marks on a channel, or tones on a finger, that is not there, and for tones beyond its band.
    """

    protocol: Protocol | JudgingProtocol

    def __post_init__(self) -> None:
        if self.protocol.marks is not None:
            self.protocol.marks.end(self.apparatus.rig.rate_hz, self.apparatus.rig.channels)
        for finger, hertz in self.places():
            low, high = self.apparatus.channel(finger).threshold.band_hz
            if not low <= hertz <= high:
                raise BadInput(f"{hertz:g} Hz on finger {finger!r}", f"{low:g} to {high:g} Hz")

    def places(self) -> Iterable[tuple[str, float]]:
        """Return finger and frequency of every tone that the file places."""
        raise NotImplementedError

    def levels(self) -> Iterator[tuple[str, str, float, float]]:
        """Yield what a level is that the file sets, its finger and frequency, and the level."""
        raise NotImplementedError

    def faults(self) -> Iterator[BadInput]:
        yield from super().faults()
        for what, finger, hertz, level in dict.fromkeys(self.levels()):
            most = self.apparatus.highest_db_sl(finger, hertz)
            if level > most:
                got = f"{what} of {level:g} dB SL at {hertz:g} Hz on finger {finger!r}"
                yield BadInput(got, f"{most:.1f} dB SL at most, which the display plays there")

    def fingers(self, planned: PlannedRun) -> tuple[str, ...]:
        """Return the fingers that a run stimulates."""
        return (planned.finger,)

    def answer_of(self, who: Listener, trial: Trial, felt_db_re_1um: FloatArray, rng: np.random.Generator) -> str:
        """Return what a simulated person answers to a trial whose intervals were felt at these levels, (m,)."""
        raise NotImplementedError

    def expected(self, planned: PlannedRun) -> tuple[float, float]:
        hertz, timing = planned.frequency_hz or self.apparatus.middle_hz, self.protocol.timing
        played_s = timing.played_s(hertz, max(len(self.question.intervals), 1), self.protocol.marks)
        return planned.typical_trials, played_s + self.rules.feedback_s

    def play(self, following: NextTrial, watch: Watch, halted: Callable[[], bool], presented: datetime) -> PlayedTrial:
        timing, trial = self.protocol.timing, following.trial
        presenter = Presenter(self.apparatus.rig, watch, halted, self.protocol.marks)
        references = [self.reference(following, interval) for interval in range(len(trial.tones))]
        shown = presenter.present(references, timing.lead_s, timing.gap_s)
        records = tuple(map(self._record, trial.stimuli, trial.tones, shown.intervals))
        hertz = None if trial.placement is None else trial.placement.frequency_hz
        curve = self.apparatus.channel(following.planned.finger).threshold.curve
        level = None if hertz is None else float(curve.level_db_re_1um_at(hertz))
        return PlayedTrial(trial, records, presented, hertz, level, shown.rig_tick, shown.lasted_s)

    def reference(self, following: NextTrial, interval: int) -> FloatArray:
        """Return the reference of an interval, (n, channels), threshold units."""
        timing, rig, tones = self.protocol.timing, self.apparatus.rig, following.trial.tones[interval]
        count = max(round((tone.onset_s + tone.lasts_s(timing)) * rig.rate_hz) for tone in tones)
        reference = np.zeros((count, len(rig.channels)))
        for tone in tones:
            level, lasts_s = float(from_db(tone.level_db_sl)), tone.lasts_s(timing)
            wave = tone_wave(tone.frequency_hz, level, lasts_s, rig.rate_hz, ramp_s=tone.ramp_s(timing))
            onset = min(round(tone.onset_s * rig.rate_hz), count - wave.size)
            reference[onset : onset + wave.size, self.apparatus.column(tone.finger)] += wave
        return reference

    def _record(self, label: str, tones: Sequence[Tone], at: PlayedInterval) -> IntervalRecord:
        """Return the interval's record; levels where it had one tone."""
        if len(tones) != 1:
            return at.record(label)
        tone, apparatus, trace = tones[0], self.apparatus, at.trace
        channel, column = apparatus.channel(tone.finger), apparatus.column(tone.finger)
        ramp_s = tone.ramp_s(self.protocol.timing)
        peak_v = amplitude(trace.position_v[:, column], tone.frequency_hz, trace.rate_hz, ramp_s)
        threshold_v = float(channel.threshold_voltage(tone.frequency_hz))
        measured = float(db(max(peak_v, _LEAST_PEAK_V) / threshold_v))
        if not np.isfinite(tone.level_db_sl):
            return at.record(label, None, measured, column)
        asked_v, hertz = np.array([threshold_v * from_db(tone.level_db_sl)]), np.array([tone.frequency_hz])
        hidden = reading_doubt_db(apparatus.controller, channel.name, hertz, asked_v)[0] > _HIDDEN_DB
        return at.record(label, tone.level_db_sl, None if hidden else measured, column)

    def envelope(self, trial: Trial, interval: int) -> Envelope:
        tones, timing, step_s = trial.tones[interval], self.protocol.timing, Envelope.STEP_S
        ends = [tone.onset_s + tone.lasts_s(timing) for tone in tones]
        levels = np.full(max(1, round(max(ends) / step_s)), Envelope.SILENT_DB_SL)
        for tone, end_s in zip(tones, ends, strict=True):
            first, last = round(tone.onset_s / step_s), max(1, round(end_s / step_s))
            rise = ramps(last - first, 1.0 / step_s, tone.ramp_s(timing))
            drawn = tone.level_db_sl + 20.0 * np.log10(np.maximum(rise, _LEAST_RISE))
            levels[first:last] = np.maximum(levels[first:last], drawn)
        hertz = {tone.frequency_hz for tone in tones}
        return Envelope.of(levels, hertz.pop() if len(hertz) == 1 else None)


@dataclass(frozen=True)
class JudgingTask(ToneTask):
    """A protocol with a task at an apparatus. Raises BadInput where the display has no such finger."""

    protocol: JudgingProtocol

    def __post_init__(self) -> None:
        super().__post_init__()
        for finger in self.protocol.task.fingers_used():
            self.apparatus.channel(finger)
        for index in range(len(self.protocol.task.plans(self.words))):
            self.protocol.task.begin(index, self.place, (0,)).trial()

    @property
    def place(self) -> Place:
        """What the task's runs are played on."""
        timing = self.protocol.timing
        return Place(self.apparatus.playable(timing), timing, self.apparatus.highest_db_sl)

    def places(self) -> Iterable[tuple[str, float]]:
        return dict.fromkeys((tone.finger, tone.frequency_hz) for tone in self.protocol.task.placed(self.place))

    def levels(self) -> Iterator[tuple[str, str, float, float]]:
        for tone in self.protocol.task.placed(self.place):
            yield "tone", tone.finger, tone.frequency_hz, tone.level_db_sl

    def faults(self) -> Iterator[BadInput]:
        yield from super().faults()
        tones = Counter(self.protocol.task.placed(self.place))
        for tone, count in tones.items():
            got = f"tone of {tone.level_db_sl:g} dB SL at {tone.frequency_hz:g} Hz on finger {tone.finger!r}"
            if count > 1:
                yield BadInput(f"{got} occurs {count} times", "each once")
            if tone.level_db_sl < -PEOPLE_DB:
                yield BadInput(got, f"{-PEOPLE_DB:g} dB SL or more: nobody feels less")
        yield from self.protocol.task.faults(self.place)

    @property
    def question(self) -> Question:
        asked = self.protocol.task.asked(self.words)
        choices = tuple(OfferedResponse(response, keys) for response, keys in asked.responses)
        return Question(asked.prompt, choices, asked.intervals)

    @property
    def rules(self) -> Rules:
        session = self.protocol.session
        return Rules.of(session, self.protocol.timing.feedback_s if session.feedback else 0.0)

    def fingers(self, planned: PlannedRun) -> tuple[str, ...]:
        return self.protocol.task.fingers_used()

    def answer_of(self, who: Listener, trial: Trial, felt_db_re_1um: FloatArray, rng: np.random.Generator) -> str:
        hertz = np.array([tones[0].frequency_hz for tones in trial.tones])
        return self.protocol.task.response_to(trial, who.judge(felt_db_re_1um, hertz, rng).tolist())

    def begin(self, planned: PlannedRun, subject: int, visit: int = 1, attempt: int = 0) -> TaskState:
        seed = self.protocol.run_seed(subject, planned.position, attempt, visit)
        state = self.protocol.task.begin(planned.part, self.place, seed)
        if planned.practice:
            state.limit = self.protocol.session.practice_trials
        return state

    def results(self, store: Store, session: int) -> tuple[ResultTable, ...]:
        runs = answered_runs(store, self.protocol.task.kind, session=session)
        notes = (self.words("results.simulated"),) if any(run.simulated for run in runs) else ()
        tables = self.protocol.task.results(runs, self.words)
        return tuple(replace(table, notes=(*notes, *table.notes)) for table in tables)


def keep_off_mains(frequency_hz: float, at: Playable, timing: Timing) -> None:
    """Raise BadInput for a frequency at which hum would be felt with the stimulus, within its own bandwidth."""

    def line_near(hertz: float) -> float | None:
        line = float(nearest_mains(hertz, at.mains_hz)) if at.mains_hz else math.inf
        return line if abs(hertz - line) < timing.clearance_hz(hertz) else None

    line = line_near(frequency_hz)
    if line is not None:
        clearance, (low, high) = timing.clearance_hz(frequency_hz), at.band_hz
        sides = math.floor(10.0 * (line - clearance)) / 10.0, math.ceil(10.0 * (line + clearance)) / 10.0
        free = [f"{side:g} Hz" for side in sides if low <= side <= high and line_near(side) is None]
        raise BadInput(
            f"{frequency_hz:g} Hz is {abs(frequency_hz - line):.3g} Hz from the mains line at {line:g} Hz",
            f"{' or '.join(free) or 'one'}, {clearance:.3g} Hz away, the bandwidth of "
            f"{timing.duration_s(frequency_hz):g} s",
        )


@dataclass(frozen=True)
class DetectionTask(ToneTask):
    """A detection protocol at an apparatus. Raises BadInput where the display has no such finger, or cannot play it."""

    protocol: Protocol

    def __post_init__(self) -> None:
        super().__post_init__()
        protocol, rig = self.protocol, self.apparatus.rig
        if protocol.masker is not None and protocol.masker.channel not in (None, *rig.channels):
            raise BadInput(f"masker: channel {protocol.masker.channel!r}", f"{', '.join(rig.channels)}")

    def places(self) -> Iterable[tuple[str, float]]:
        conditions = self.protocol.conditions
        return itertools.product(conditions.fingers, conditions.frequencies_hz or (self.apparatus.middle_hz,))

    def levels(self) -> Iterator[tuple[str, str, float, float]]:
        first = self.protocol.begin(self.apparatus.playable(self.protocol.timing)).placement()
        level, places = (-math.inf, None) if first is None else (first.level_db_sl, first.frequency_hz)
        rules = self.protocol.session
        practised = [("practice", rules.practice_level_db_sl)] if rules.practice_trials else []
        for finger in self.protocol.conditions.fingers:
            for hertz in self.protocol.frequencies_hz or (places or self.apparatus.middle_hz,):
                for what, highest in (("first level", level), *practised):
                    yield what, finger, hertz, highest

    @property
    def question(self) -> Question:
        responses = self.protocol.paradigm.responses
        if self.protocol.paradigm.yes_no:
            labels = (self.words("page.yes"), self.words("page.no"))
            choices = tuple(OfferedResponse(one, (one,), label) for one, label in zip(responses, labels, strict=True))
            return Question(self.words("prompt.yes_no"), choices)
        choices = tuple(OfferedResponse(response, (response,)) for response in responses)
        return Question(self.words("prompt.detection"), choices, responses)

    @property
    def rules(self) -> Rules:
        return Rules.of(self.protocol.session, self.protocol.timing.feedback_s)

    def enrol(self, connection: Connection, study: int) -> None:
        """Refuse a new study that would measure at the mains; one that has begun goes on, and its runs are flagged."""
        begun = select(schema.run.c.id).join(schema.session).where(schema.session.c.study_id == study).limit(1)
        if connection.execute(begun).first() is None:
            timing = self.protocol.timing
            for frequency in self.protocol.conditions.frequencies_hz:
                keep_off_mains(frequency, self.apparatus.playable(timing), timing)

    def answer_of(self, who: Listener, trial: Trial, felt_db_re_1um: FloatArray, rng: np.random.Generator) -> str:
        return trial.responses[who.respond(felt_db_re_1um, trial.tones[0][0].frequency_hz, rng)]

    def begin(self, planned: PlannedRun, subject: int, visit: int = 1, attempt: int = 0) -> DetectionState:
        protocol, playable = self.protocol, self.apparatus.playable(self.protocol.timing)
        procedure = protocol.begin_practice() if planned.practice else protocol.begin(playable)
        seed = protocol.run_seed(subject, planned.position, attempt, visit)
        return DetectionState(seed, procedure, protocol, planned)

    def reference(self, following: NextTrial, interval: int) -> FloatArray:
        reference, masker = super().reference(following, interval), self.protocol.masker
        if masker is not None:
            rng, rig = trial_rng((*following.seed, 2, interval), following.trial.number), self.apparatus.rig
            ramp_s = following.trial.tones[interval][0].ramp_s(self.protocol.timing)
            channel = masker.channel or self.apparatus.channel(following.planned.finger).name
            reference[:, rig.channels.index(channel)] += masker.wave(len(reference), rig.rate_hz, ramp_s, rng)
        return reference

    def results(self, store: Store, session: int) -> tuple[ResultTable, ...]:
        return (threshold_table(thresholds(detection_runs(store, session=session)), self.words),)


@dataclass
class DetectionState(ProcedureState):
    """State of one run: each trial's frequency is the run's unless the procedure chooses it too."""

    protocol: Protocol
    planned: PlannedRun

    def draw(self, number: int) -> Trial | None:
        """Return the trial where the procedure puts it, a catch trial by the lot of its number, or None at the end."""
        placement, catch = self.procedure.placement(), self.protocol.catch
        if placement is None:
            return None
        if placement.frequency_hz is None:
            placement = replace(placement, frequency_hz=self.planned.frequency_hz)
        lot = 1.0 if self.planned.practice else float(trial_rng((*self.seed, 9), number).random())
        label = LOUD if lot < catch.loud_share else BLANK if lot < catch.loud_share + catch.blank_share else SIGNAL
        if label == LOUD:
            placement = replace(placement, level_db_sl=min(placement.level_db_sl + catch.above_db, COMFORT_DB_SL))
        return self.protocol.paradigm.trial(number, self.planned.finger, placement, self.seed, label)

    def learn(self, trial: Trial, response: str, correct: bool) -> None:
        """Move the procedure on, unless it was a catch trial."""
        if SIGNAL in trial.stimuli:
            super().learn(trial, response, correct)

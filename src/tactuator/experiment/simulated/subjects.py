"""Simulated subjects on a simulated display, a whole study with them into a store, and a respondent that errs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.presenter import amplitude
from tactuator.experiment.procedure.curve_prior import CurveKind
from tactuator.experiment.protocol.file import protocol_hash
from tactuator.experiment.protocol.study import StudyProtocol
from tactuator.experiment.session.respondent import Respondent, run_session
from tactuator.experiment.session.studies import open_session, open_study, task_of
from tactuator.experiment.session.task import Apparatus, Clock, NextTrial
from tactuator.experiment.session.tone_task import ToneTask
from tactuator.experiment.store.records import PlayedTrial, Visit
from tactuator.experiment.store.store import Store
from tactuator.experiment.trial import IntervalRecord, Tone, Trial, trial_rng
from tactuator.perception.curve import RelativeCurve, ThresholdCurve
from tactuator.perception.psychometric import Psychometric, Weibull
from tactuator.rig.rig import Finger, require_finger_ports
from tactuator.signals.decibels import db


@dataclass(frozen=True)
class Observer:
    """A subject with a threshold curve.

    curve: level (dB re 1 um peak) at which psi reaches its target. Each interval is noticed independently with
    probability F (a high threshold), the strongest of those is picked, and guessed where none was noticed; with the
    signal in one interval that is psi exactly. A lapse ignores what was felt, with probability lapse / (1 - guess), so
    that the highest psi is 1 - lapse.
    """

    name: str
    curve: ThresholdCurve
    psychometric: Psychometric = field(default_factory=lambda: Psychometric(Weibull(2.5), lapse=0.02))

    def respond(self, felt_db_re_1um: ArrayLike, frequency_hz: float, rng: np.random.Generator) -> int:
        """Return the index of the interval picked; felt_db_re_1um: (m,) level of each."""
        level = np.asarray(felt_db_re_1um) - float(self.curve.level_db_re_1um_at(frequency_hz))
        psychometric, even = self.psychometric, np.full(level.size, 1.0 / level.size)
        inattentive = rng.random() < psychometric.lapse / (1.0 - psychometric.guess)
        noticed = rng.random(level.size) < psychometric.rise(level)
        strongest = int(np.argmax(np.where(noticed, level, -np.inf)))
        picked = strongest if noticed.any() else int(rng.choice(level.size, p=even))
        return int(rng.choice(level.size, p=even)) if inattentive else picked

    def judge(self, felt_db_re_1um: ArrayLike, frequency_hz: ArrayLike, rng: np.random.Generator) -> FloatArray:
        """Return how strong each interval feels, (m,): as far as it lies above the own threshold, with noise, dB SL."""
        felt_db_sl = np.asarray(felt_db_re_1um) - self.curve.level_db_re_1um_at(frequency_hz)
        return np.asarray(felt_db_sl + rng.normal(0.0, _JUDGED_SD_DB, felt_db_sl.size))


_JUDGED_SD_DB = 2.0
"""Noise of a felt strength, dB: one in four comparisons of tones 1.9 dB apart is wrong."""
_LEAST_MM, _UM_PER_MM = 1e-12, 1000.0


LOW_RAISED_DB, HIGH_LOWERED_DB = 4.0, -5.0
"""The paper's finding (its figure 11): thresholds on the display higher at low, lower at high frequencies."""


def simulated_observers(
    library: ThresholdCurve, count: int, seed: int, band_hz: tuple[float, float] = (0.4, 300.0)
) -> tuple[Observer, ...]:
    """Return observers whose truth is the library curve, tilted as the paper found, with individual differences.

    The differences are an offset of standard deviation 1.5 dB, a tilt of 1 dB/decade and a wave of 1 dB; slopes are 2
    to 3 and lapse rates up to 2 %.
    """
    rng = np.random.default_rng([seed, 11])
    frequency_hz = np.geomspace(*band_hz, 40)
    share = np.log(frequency_hz / band_hz[0]) / np.log(band_hz[1] / band_hz[0])
    common = library.level_db_re_1um_at(frequency_hz) + LOW_RAISED_DB + (HIGH_LOWERED_DB - LOW_RAISED_DB) * share
    people = CurveKind("simulated subjects", offset_db=1.5, tilt_db_per_decade=1.0, wave_db=1.0)
    drawn = people.draw(frequency_hz, float(np.sqrt(band_hz[0] * band_hz[1])), count, rng)
    observers = []
    for number in range(count):
        name = f"S{number + 1}"
        curve = ThresholdCurve(
            f"truth of {name}", frequency_hz, common + drawn[number], "simulated", "simulated observer"
        )
        model = Psychometric(Weibull(float(rng.uniform(2.0, 3.0))), lapse=float(rng.uniform(0.0, 0.02)))
        observers.append(Observer(name, curve, model))
    return tuple(observers)


def with_truths(
    observers: Sequence[Observer],
    codes: Sequence[str],
    library: ThresholdCurve,
    truths: Mapping[str, RelativeCurve],
    lapses: Mapping[str, float],
) -> tuple[Observer, ...]:
    """Return the observers with given truths: curves relative to `library` and lapse rates, by the subject's code.

    Raises BadInput for a code that is not among `codes`, and for a lapse rate that psi cannot have.
    """
    strangers = sorted((set(truths) | set(lapses)) - set(codes))
    if strangers:
        raise BadInput(f"truth of {', '.join(strangers)}", f"of the protocol's subjects {', '.join(codes)}")
    replaced = []
    for code, observer in zip(codes, observers, strict=True):
        if code in truths:
            truth = truths[code]
            frequency_hz = np.union1d(np.geomspace(0.1, 1000.0, 241), truth.frequency_hz)
            level = library.level_db_re_1um_at(frequency_hz) + truth.level_db_sl_at(frequency_hz)
            curve = ThresholdCurve(
                f"truth of {code}", frequency_hz, level, "simulated", f"{truth.name} over {library.name}"
            )
            observer = replace(observer, curve=curve)
        if code in lapses:
            observer = replace(observer, psychometric=replace(observer.psychometric, lapse=lapses[code]))
        replaced.append(observer)
    return tuple(replaced)


def run_study(
    store: Store,
    protocol: StudyProtocol,
    text: str,
    apparatus: Apparatus,
    people: Sequence[Observer],
    clock: Clock,
    load: str | None = None,
    show: Callable[[int, float], None] = lambda place, share: None,
) -> int:
    """Take everybody through their session, resumed if it was begun, and return the study's row in the store.

    load: put on the display's ports while fingers are there. show: called with the subject's place and its progress, 0
    to 1. Raises BadInput where there are not as many people as subjects, or they cannot answer.
    """
    require_finger_ports(apparatus.rig, apparatus.name)
    if len(people) != len(protocol.subject):
        raise BadInput(f"{len(people)} people for {len(protocol.subject)} subjects", "as many")
    protocol.require_observers()
    task = task_of(protocol, Path(), apparatus)
    assert isinstance(task, ToneTask)
    mark = protocol_hash(text)[:12]
    study = open_study(store, task, text, clock, lambda code, visit: f"simulated-{mark}-{code}-{visit}")
    for place, (subject, who) in enumerate(zip(protocol.subject, people, strict=True)):
        session, observer = open_session(study, subject.code, Visit("simulated")), AtRig(who, task, load)
        try:
            run_session(session, observer, lambda now: show(place, now.progress))  # noqa: B023
        finally:
            observer.leave()
    return study.id


class AtRig(Respondent):
    """An observer whose fingers are on the channels of each run, with that load.

    Of a tone the peak displacement at its frequency is felt, hum, noise and friction included: a matched filter takes
    it from the stretch that the interval's record names.
    """

    def __init__(self, who: Observer, task: ToneTask, load: str | None) -> None:
        self.who, self.task, self._load = who, task, load
        self._felt_mm: dict[str, list[FloatArray]] = {}
        self._ports: list[tuple[Finger, Callable[[FloatArray], None]]] = []

    def begin(self, following: NextTrial) -> None:
        self.leave()
        self._seed, apparatus = following.seed, self.task.apparatus
        for finger in self.task.fingers(following.planned):
            feel = self._felt_mm.setdefault(finger, []).append
            port = apparatus.rig.finger(apparatus.channel(finger).name)
            port.touch(self._load)
            port.attach(feel)
            self._ports.append((port, feel))

    def presented(self, played: PlayedTrial) -> None:
        self._played = played

    def respond(self, trial: Trial) -> str:
        felt = {finger: np.concatenate(parts) for finger, parts in self._felt_mm.items()}
        for parts in self._felt_mm.values():
            parts.clear()
        levels = [
            max(self._level_db_re_1um(tone, at, felt[tone.finger]) for tone in tones)
            for tones, at in zip(trial.tones, self._played.intervals, strict=True)
        ]
        return self.task.answer_of(self.who, trial, np.array(levels), trial_rng((*self._seed, 1), trial.number))

    def _level_db_re_1um(self, tone: Tone, record: IntervalRecord, felt: FloatArray) -> float:
        assert record.onset_s is not None
        timing, rate_hz = self.task.protocol.timing, self.task.apparatus.rig.rate_hz
        began = felt.size - round(self._played.lasted_s * rate_hz) + round(record.onset_s * rate_hz)
        onset = began + round(tone.onset_s * rate_hz)
        stretch = felt[onset : onset + round(tone.lasts_s(timing) * rate_hz)]
        peak_mm = amplitude(stretch, tone.frequency_hz, rate_hz, tone.ramp_s(timing))
        return float(db(max(peak_mm, _LEAST_MM) * _UM_PER_MM))

    def leave(self) -> None:
        """Take the fingers off the display."""
        for port, feel in self._ports:
            port.detach(feel)
            port.touch(None)
        self._ports.clear()
        self._felt_mm.clear()


@dataclass
class ErringRespondent(Respondent):
    """A respondent that is right with probability 1 - error and otherwise gives any other answer, all alike.

    Raises BadInput for an error rate outside [0, 1].
    """

    error: float
    rng: np.random.Generator

    def __post_init__(self) -> None:
        if not 0.0 <= self.error <= 1.0:
            raise BadInput(f"error rate {self.error:g}", "0 to 1")

    def respond(self, trial: Trial) -> str:
        if self.rng.random() >= self.error:
            return trial.correct
        others = [response for response in trial.responses if response != trial.correct]
        return others[int(self.rng.integers(len(others)))]

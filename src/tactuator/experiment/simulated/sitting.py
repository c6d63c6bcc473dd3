"""Simulated subjects on a simulated display, a whole study with them into a store, and a respondent that errs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.presenter import amplitude
from tactuator.experiment.procedure.curve_prior import CurveKind
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.protocol.file import protocol_hash
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.session.presented_session import PresentedSession, Respondent, run_session
from tactuator.experiment.session.session import NextTrial
from tactuator.experiment.session.studies import open_session, open_study
from tactuator.experiment.session.task import Apparatus, Clock
from tactuator.experiment.store.records import PlayedTrial, Sitting
from tactuator.experiment.store.store import Store
from tactuator.experiment.trial import Trial, trial_rng
from tactuator.perception.curve import RelativeCurve, ThresholdCurve
from tactuator.perception.psychometric import MaxOfM, Psychometric, Weibull
from tactuator.rig.rig import Rig, require_finger_ports
from tactuator.signals.decibels import db


@dataclass(frozen=True)
class Observer:
    """A subject with a threshold curve of its own.

    curve: level (dB re 1 um peak) at which psi reaches its target. A Weibull or logistic observer notices each interval
    independently with probability F (a high threshold), picks the strongest that it noticed, and guesses where it
    noticed none; with the signal in one interval that is psi exactly. A MaxOfM observer takes the largest of m noisy
    impressions. interval_bias: weights of the intervals in guesses and lapses (none: even). drift_db_per_trial: rise of
    the threshold from trial to trial. Raises BadInput for weights that cannot be.
    """

    name: str
    curve: ThresholdCurve
    psychometric: Psychometric = field(default_factory=lambda: Psychometric(Weibull(2.5), lapse=0.02))
    interval_bias: tuple[float, ...] | None = None
    drift_db_per_trial: float = 0.0

    def __post_init__(self) -> None:
        bias = self.interval_bias
        if bias is not None and (len(bias) < 2 or min(bias) < 0.0 or sum(bias) <= 0.0):
            raise BadInput(f"observer {self.name!r}: interval_bias {list(bias)}", "weights >= 0, not all zero")

    def respond(self, felt_db_re_1um: ArrayLike, frequency_hz: float, trial: int, rng: np.random.Generator) -> int:
        """Return the index of the interval picked; felt_db_re_1um: (m,) level of each; trial: counted from 0."""
        threshold = float(self.curve.level_db_re_1um_at(frequency_hz)) + self.drift_db_per_trial * trial
        level = np.asarray(felt_db_re_1um, dtype=np.float64) - threshold
        return respond(self.psychometric, level, self._weights(level.size), rng)

    def _weights(self, intervals: int) -> FloatArray:
        if self.interval_bias is None:
            return np.full(intervals, 1.0 / intervals)
        if len(self.interval_bias) != intervals:
            raise BadInput(
                f"observer {self.name!r}: interval_bias has {len(self.interval_bias)} weights for {intervals} intervals"
            )
        weights = np.asarray(self.interval_bias, dtype=np.float64)
        return weights / float(weights.sum())


def respond(psychometric: Psychometric, level_db: FloatArray, weights: FloatArray, rng: np.random.Generator) -> int:
    """Return the index of the interval picked; level_db: (m,) re own threshold; weights: (m,) of guesses.

    A lapse ignores what was felt, with probability lapse / (1 - guess), so that the highest psi is 1 - lapse.
    """
    intervals = level_db.size
    inattentive = rng.random() < psychometric.lapse / (1.0 - psychometric.guess)
    if isinstance(psychometric.shape, MaxOfM):
        impression = psychometric.shape.d_prime(level_db, psychometric.at_threshold) + rng.standard_normal(intervals)
        impression += _criterion_shift(weights)
        picked = int(np.argmax(impression))
    else:
        noticed = rng.random(intervals) < psychometric.rise(level_db)
        strongest = int(np.argmax(np.where(noticed, level_db, -np.inf)))
        picked = strongest if noticed.any() else int(rng.choice(intervals, p=weights))
    return int(rng.choice(intervals, p=weights)) if inattentive else picked


def _criterion_shift(weights: FloatArray) -> FloatArray:
    """Return what is added to each impression so that preferred intervals win more often; zero for even weights."""
    return np.asarray(np.log(np.maximum(weights, 1e-6) * weights.size))


_UM_PER_MM = 1000.0


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
    protocol: Protocol,
    text: str,
    apparatus: Apparatus,
    observers: Sequence[Observer],
    clock: Clock,
    load: str | None = None,
    show: Callable[[str, float], None] = lambda name, share: None,
) -> int:
    """Take every observer through its session, resumed if it was begun, and return the study's row in the store.

    load: put on the display's port while an observer's finger is there. show: called with the name of the subject and
    its progress, 0 to 1. Raises BadInput where the number of observers is not that of the subjects.
    """
    rig = apparatus.rig
    require_finger_ports(rig, apparatus.name)
    if len(observers) != len(protocol.subject):
        raise BadInput(f"{len(observers)} observers for {len(protocol.subject)} subjects", "as many")
    if protocol.paradigm.yes_no:
        raise BadInput("1: simulated observers tell intervals apart", "two intervals or more", key="paradigm.intervals")
    task = DetectionTask(protocol, apparatus)
    mark = protocol_hash(text)[:12]
    study = open_study(store, task, text, clock, lambda code, visit: f"simulated-{mark}-{code}-{visit}")
    for subject, observer in zip(protocol.subject, observers, strict=True):
        session = open_session(study, subject.code, sitting=Sitting("simulated"))
        sitting = ObserverAtRig(observer, task, rig, load)
        try:
            run_session(PresentedSession(session), sitting, lambda now: show(observer.name, now.progress))  # noqa: B023
        finally:
            sitting.leave()
    return study.id


class ObserverAtRig(Respondent):
    """An observer whose finger goes to the channel of each run, with that load.

    It judges each interval by the peak displacement at the stimulus's frequency, hum, noise and friction included. A
    matched filter takes it from the stretches that the records of the intervals name.
    """

    def __init__(self, observer: Observer, task: DetectionTask, rig: Rig, load: str | None) -> None:
        self._observer, self._task, self._rig, self._load = observer, task, rig, load
        self._felt_mm: list[FloatArray] = []
        self._channel: str | None = None

    def begin(self, following: NextTrial) -> None:
        """Put the finger on the run's channel."""
        self.leave()
        self._seed = following.seed
        self._channel = self._task.apparatus.channel(following.planned.finger).name
        port = self._rig.finger(self._channel)
        port.touch(self._load)
        port.attach(self._feel)

    def _feel(self, displacement_mm: FloatArray) -> None:
        self._felt_mm.append(displacement_mm)

    def presented(self, played: PlayedTrial) -> None:
        """Keep the trial's intervals as they were played."""
        self._played = played

    def respond(self, trial: Trial) -> str:
        """Return the interval in which the most was felt, and forget what was felt so far."""
        placement = trial.placement
        assert placement is not None
        assert placement.frequency_hz is not None
        levels = self._levels_db_re_1um(placement.frequency_hz)
        self._felt_mm.clear()
        rng = trial_rng((*self._seed, 1), trial.number)
        return trial.responses[self._observer.respond(levels, placement.frequency_hz, trial.number, rng)]

    def _levels_db_re_1um(self, frequency_hz: float) -> FloatArray:
        """Return the level felt in each interval of the trial that was just played, shape (m,)."""
        felt, rate_hz = np.concatenate(self._felt_mm), self._rig.rate_hz
        begins = felt.size - round(self._played.lasted_s * rate_hz)
        ramp_s, peaks_mm = self._task.protocol.timing.ramp_at_s(frequency_hz), []
        for interval in self._played.intervals:
            assert interval.onset_s is not None
            assert interval.duration_s is not None
            onset = begins + round(interval.onset_s * rate_hz)
            stretch = felt[onset : onset + round(interval.duration_s * rate_hz)]
            peaks_mm.append(amplitude(stretch, frequency_hz, rate_hz, ramp_s))
        return db(np.maximum(np.array(peaks_mm), 1e-12) * _UM_PER_MM)

    def leave(self) -> None:
        """Take the finger off the display."""
        if self._channel is not None:
            port = self._rig.finger(self._channel)
            port.detach(self._feel)
            port.touch(None)
            self._channel = None
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
        """Return the right answer or, at the error rate, another."""
        if self.rng.random() >= self.error:
            return trial.correct
        others = [response for response in trial.responses if response != trial.correct]
        return others[int(self.rng.integers(len(others)))]

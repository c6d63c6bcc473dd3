"""A whole study with simulated subjects at a simulated display, into a store."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tactuator.errors import BadInput
from tactuator.experiment.procedure.whole_curve.curve_kind import CurveKind
from tactuator.experiment.protocol.file import protocol_hash
from tactuator.experiment.protocol.protocol import Protocol
from tactuator.experiment.session.apparatus import Apparatus
from tactuator.experiment.session.clock import Clock
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.session.presented_session import PresentedSession
from tactuator.experiment.session.respondent import Respondent, run_session
from tactuator.experiment.session.standing import NextTrial
from tactuator.experiment.session.studies import open_session, open_study
from tactuator.experiment.simulated.observer import Observer
from tactuator.experiment.simulated.observer_at_rig import ObserverAtRig
from tactuator.experiment.store.answer_records import PlayedTrial
from tactuator.experiment.store.run_records import Sitting
from tactuator.experiment.store.store import Store
from tactuator.experiment.trial.trial import Trial
from tactuator.perception.curve import RelativeCurve, ThresholdCurve
from tactuator.perception.psychometric import Psychometric, Weibull
from tactuator.rig.touchable import TouchableRig, touchable

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
    own = people.draw(frequency_hz, float(np.sqrt(band_hz[0] * band_hz[1])), count, rng)
    observers = []
    for number in range(count):
        name = f"S{number + 1}"
        curve = ThresholdCurve(
            f"truth of {name}", frequency_hz, common + own[number], "simulated", "simulated observer"
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
    found = []
    for code, observer in zip(codes, observers, strict=True):
        if code in truths:
            own = truths[code]
            frequency_hz = np.union1d(np.geomspace(0.1, 1000.0, 241), own.frequency_hz)
            level = library.level_db_re_1um_at(frequency_hz) + own.level_db_sl_at(frequency_hz)
            curve = ThresholdCurve(
                f"truth of {code}", frequency_hz, level, "simulated", f"{own.name} over {library.name}"
            )
            observer = replace(observer, curve=curve)
        if code in lapses:
            observer = replace(observer, psychometric=replace(observer.psychometric, lapse=lapses[code]))
        found.append(observer)
    return tuple(found)


def run_study(
    store: Store,
    protocol: Protocol,
    text: str,
    apparatus: Apparatus,
    observers: Sequence[Observer],
    clock: Clock,
    load: str | None = None,
    told: Callable[[str, float], None] = lambda name, progress: None,
) -> int:
    """Take every observer through its session, resumed if it was begun, and return the study's row in the store.

    load: put on the display's port while an observer's finger is there. told: called with the name of the subject and
    its progress, 0 to 1. Raises BadInput where the number of observers is not that of the subjects.
    """
    rig = touchable(apparatus.rig, apparatus.name)
    if len(observers) != len(protocol.subject):
        raise BadInput(f"{len(observers)} observers for {len(protocol.subject)} subjects", "as many")
    task = DetectionTask(protocol, apparatus)
    mark = protocol_hash(text)[:12]
    study = open_study(store, task, text, clock, lambda code, visit: f"simulated-{mark}-{code}-{visit}")
    for subject, observer in zip(protocol.subject, observers, strict=True):
        session = open_session(study, subject.code, sitting=Sitting("simulated"))
        sitting = _Sitting(observer, task, rig, load)
        try:
            run_session(PresentedSession(session), sitting, lambda now, name=observer.name: told(name, now.progress))  # type: ignore[misc]
        finally:
            sitting.leave()
    return study.id


class _Sitting(Respondent):
    """An observer at the rig, whose finger goes to the channel of each run."""

    def __init__(self, observer: Observer, task: DetectionTask, rig: TouchableRig, load: str | None) -> None:
        self._observer, self._task, self._rig, self._load = observer, task, rig, load
        self._at: ObserverAtRig | None = None

    def begin(self, following: NextTrial) -> None:
        """Put the finger on the run's channel."""
        self.leave()
        channel = self._task.apparatus.channel(following.planned.finger).name
        timing = self._task.protocol.timing.build()
        self._at = ObserverAtRig(self._observer, self._rig, channel, timing, following.seed, self._load)

    def presented(self, played: PlayedTrial) -> None:
        """Keep the trial's intervals as they were played."""
        self._played = played

    def respond(self, trial: Trial) -> str:
        """Return the interval in which the most was felt."""
        assert self._at is not None
        assert trial.placement is not None
        assert trial.placement.frequency_hz is not None
        return self._at.answer(trial, trial.placement.frequency_hz, self._played.intervals, self._played.lasted_s)

    def leave(self) -> None:
        """Take the finger off the display."""
        if self._at is not None:
            self._at.leave()
            self._at = None

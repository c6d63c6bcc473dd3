"""A whole study with simulated subjects at a simulated display, into a store."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from tactuator.errors import BadInput
from tactuator.experiment import records
from tactuator.experiment.clock import Clock
from tactuator.experiment.conduct import Conduct, Station
from tactuator.experiment.curve_prior import CurvePrior
from tactuator.experiment.fingertip import ObserverAtRig
from tactuator.experiment.observer import Observer
from tactuator.experiment.protocol import Protocol
from tactuator.experiment.session import Session
from tactuator.experiment.store import Store
from tactuator.perception.curve import ThresholdCurve
from tactuator.perception.psychometric import Psychometric, Weibull
from tactuator.rig.simulated import SimulatedRig

LOW_RAISED_DB, HIGH_LOWERED_DB = 4.0, -5.0
"""The paper's finding (its figure 11): thresholds on the display higher at low, lower at high frequencies."""


def simulated_observers(
    library: ThresholdCurve, count: int, seed: int, band_hz: tuple[float, float] = (0.4, 300.0)
) -> tuple[Observer, ...]:
    """Observers whose truth is the library curve, tilted as the paper found, with differences of their own.

    Individual differences: offset sd 1.5 dB, tilt 1 dB/decade, wave 1 dB; slopes 2 to 3, lapses up to 2 %.
    """
    rng = np.random.default_rng([seed, 11])
    frequency_hz = np.geomspace(*band_hz, 40)
    share = np.log(frequency_hz / band_hz[0]) / np.log(band_hz[1] / band_hz[0])
    common = library.level_db_re_1um_at(frequency_hz) + LOW_RAISED_DB + (HIGH_LOWERED_DB - LOW_RAISED_DB) * share
    prior = CurvePrior(band_hz, offset_db=1.5, tilt_db_per_decade=1.0, wave_db=1.0)
    own = prior.draw(frequency_hz, count, rng)
    observers = []
    for number in range(count):
        name = f"S{number + 1}"
        curve = ThresholdCurve(
            f"truth of {name}", frequency_hz, common + own[number], "synthetic", "simulated observer"
        )
        model = Psychometric(Weibull(float(rng.uniform(2.0, 3.0))), lapse=float(rng.uniform(0.0, 0.02)))
        observers.append(Observer(name, curve, model))
    return tuple(observers)


def run_study(
    store: Store,
    protocol: Protocol,
    text: str,
    station: Station,
    observers: Sequence[Observer],
    clock: Clock,
    load: str | None = None,
    told: Callable[[str, float], None] = lambda name, progress: None,
) -> int:
    """Every observer goes through its session (resumed if it was begun); the study's row in the store.

    load: put on the display's port while an observer's finger is there. told: name of the subject and progress, 0 to 1.
    """
    rig = station.rig
    if not isinstance(rig, SimulatedRig):
        raise BadInput(f"simulated subjects at {station.name}; allowed: at the simulated display")
    if len(observers) != len(protocol.subject):
        raise BadInput(f"{len(observers)} observers for {len(protocol.subject)} subjects; allowed: as many")
    station.check(protocol)
    tokens = [f"simulated-{protocol.study.seed}-{number}" for number in range(len(observers))]
    with store.begin() as connection:
        study = records.open_study(connection, protocol, text, clock.utc(), tokens)
        rows = records.sessions(connection, study)
    for row, observer in zip(rows, observers, strict=True):
        session = Session(store, row.id, row.subject_number, protocol, station.apparatus, station.band_hz, clock)
        _attend(Conduct(session, station, clock), rig, observer, load, told)
    return study


def _attend(
    conduct: Conduct, rig: SimulatedRig, observer: Observer, load: str | None, told: Callable[[str, float], None]
) -> None:
    session = conduct.session
    if session.stage == "consent":
        session.give_consent()
    subject: ObserverAtRig | None = None
    while session.stage != "done":
        if session.stage == "break":
            session.end_break()
        following = session.next_trial()
        channel = conduct.station.channel(following.planned.finger).name
        if subject is None or subject.channel != channel or subject.seed != following.seed:
            if subject is not None:
                subject.leave()
            subject = ObserverAtRig(observer, rig, channel, conduct.timing, following.seed, load)
        conduct.present(subject.begins)
        response = subject.answer(following.trial, following.frequency_hz)
        conduct.answer(records.Answer(response, conduct.clock.utc()))
        told(observer.name, session.progress)
    if subject is not None:
        subject.leave()

"""Steps 9 and 10: thresholds of simulated observers through the display, and the curve that comes of them."""

from __future__ import annotations

import multiprocessing
import signal
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.display.controller import Controller
from tactuator.experiment.procedure.up_down import IMECE2004, UpDown
from tactuator.experiment.simulated.observer import Observer
from tactuator.experiment.simulated.observer_at_rig import ObserverAtRig
from tactuator.experiment.trial.delivered_level import delivered_offset_db
from tactuator.experiment.trial.detection_run import Detection, RunRecord, run_detection
from tactuator.experiment.trial.presenter import Presenter
from tactuator.experiment.trial.timing import Timing
from tactuator.paper.plan import THRESHOLD_HZ, Plan, Progress, observers
from tactuator.perception.curve import ThresholdCurve
from tactuator.rig.simulated import SimulatedRig

_START_ABOVE_DB = 20.0
_HIGHEST_HZ = 300.0
_WORKER_COUNT = 2


@dataclass(frozen=True)
class Threshold:
    """One run's outcome. commanded_db_sl: the paper's number (mean of 12 reversals); level_db_re_1um: the same as
    displacement, by what the sensor saw of the stimuli near it; refit_db_re_1um, se_db: the Bayesian refit of the same
    trials and its standard deviation; true_db: the observer's own 79.4 % point."""

    observer: str
    channel: str
    frequency_hz: float
    commanded_db_sl: float
    level_db_re_1um: float
    refit_db_re_1um: float
    se_db: float
    true_db: float
    trials: int


def measure_thresholds(plan: Plan, controller: Controller, progress: Progress) -> tuple[Threshold, ...]:
    """Measure every observer on every channel at THRESHOLD_HZ by the paper's procedure, felt through the simulated
    display.

    Two processes share the work; the outcome does not depend on how it is shared.
    """
    people = observers(plan.display.channels[0].threshold.curve)
    tasks = [(person, channel.name) for person in people for channel in plan.display.channels]
    found: dict[tuple[str, str], tuple[Threshold, ...]] = {}
    # spawned, not forked: a progress bar's thread may hold a lock at that moment
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(_WORKER_COUNT, context, initializer=_leave_interrupts_to_the_parent)
    try:
        jobs = {pool.submit(one_observer, plan, controller, *task): (task[0].name, task[1]) for task in tasks}
        for done, job in enumerate(as_completed(jobs), start=1):
            found[jobs[job]] = job.result()
            progress("thresholds", done / len(tasks))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    return tuple(one for person, channel in tasks for one in found[person.name, channel])


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def one_observer(plan: Plan, controller: Controller, observer: Observer, channel: str) -> tuple[Threshold, ...]:
    """Measure all of one observer's runs on one channel."""
    alone = only(controller, channel)
    rig = SimulatedRig(alone.display, plan.seed_of(f"thresholds of {observer.name}, {channel}"))
    rig.load(alone)
    timing = Timing()
    detection = Detection(Presenter(rig, channel), alone.display.channels[0], timing)
    loads = alone.display.channels[0].loads
    found = []
    for index, hertz in enumerate(THRESHOLD_HZ):
        seed = (plan.seed_of(f"trials of {observer.name}, {channel}"), index)
        subject = ObserverAtRig(observer, rig, channel, timing, seed, loads[0].name if loads else None)
        start = _start_db_sl(observer, alone.display.channels[0].threshold.curve, hertz)
        run = run_detection(detection, UpDown(IMECE2004, start), subject, hertz, seed)
        subject.leave()
        found.append(_outcome(run, observer, channel, alone.display.channels[0].threshold.curve))
    return tuple(found)


def only(controller: Controller, channel: str) -> Controller:
    """Return the controller of one channel, on a display that has no other."""
    display = replace(controller.display, channels=(controller.display.channel(channel),))
    return Controller(display, (controller.channel(channel),), controller.tool)


def _start_db_sl(observer: Observer, library: ThresholdCurve, hertz: float) -> float:
    """Return a level well above what is expected, on a whole decibel, as an experimenter who knows roughly
    would start.
    """
    expected = float(observer.curve.level_db_re_1um_at(hertz) - library.level_db_re_1um_at(hertz))
    return float(round(expected)) + _START_ABOVE_DB


def _outcome(run: RunRecord, observer: Observer, channel: str, library: ThresholdCurve) -> Threshold:
    assert run.estimate is not None
    hertz, level = run.frequency_hz, run.estimate.level_db_sl
    refit = run.refit()
    intervals = [interval for trial in run.trials for interval in trial.intervals]
    base = float(library.level_db_re_1um_at(hertz)) + delivered_offset_db(intervals, level)
    return Threshold(
        observer=observer.name,
        channel=channel,
        frequency_hz=hertz,
        commanded_db_sl=level,
        level_db_re_1um=base + level,
        refit_db_re_1um=base + float(refit.threshold_db[0]),
        se_db=float(refit.sd_db[0]),
        true_db=float(observer.curve.level_db_re_1um_at(hertz)),
        trials=len(run.trials),
    )


def new_curve(library: ThresholdCurve, thresholds: tuple[Threshold, ...]) -> ThresholdCurve:
    """Return the library curve moved to the observers, at its own frequencies from the lowest measured up to 300 Hz.

    Each observer's differences from the library are smoothed by a parabola in log frequency (least squares; the last
    4 Hz are extrapolated); the curve moves by the mean of the parabolas. standard_error_db: of that mean, from how the
    parabolas differ.
    """
    frequency = np.array(sorted({one.frequency_hz for one in thresholds}))
    people = sorted({one.observer for one in thresholds})
    own = library.frequency_hz[(library.frequency_hz >= frequency[0]) & (library.frequency_hz <= _HIGHEST_HZ)]
    moves = []
    for who in people:
        differences = [_difference(library, thresholds, who, hertz) for hertz in frequency]
        moves.append(np.polyval(np.polyfit(np.log10(frequency), differences, 2), np.log10(own)))
    level = library.level_db_re_1um_at(own) + np.mean(moves, axis=0)
    error = np.std(moves, axis=0, ddof=1) / np.sqrt(len(people))
    source = f"{len(people)} simulated observers on the display, {library.name} moved by a parabola in log frequency"
    return ThresholdCurve("measured here", own, level, "measured", source, error)


def _difference(library: ThresholdCurve, thresholds: tuple[Threshold, ...], observer: str, hertz: float) -> float:
    """Return an observer's mean over the fingers, less the library's level, dB."""
    levels = [one.level_db_re_1um for one in thresholds if (one.observer, one.frequency_hz) == (observer, hertz)]
    return float(np.mean(levels) - library.level_db_re_1um_at(hertz))


def bias_and_spread_db(thresholds: tuple[Threshold, ...]) -> tuple[float, float]:
    """Return the mean and standard deviation of estimate less truth over all runs (facts: about -0.4 and 1 dB)."""
    errors: FloatArray = np.array([one.level_db_re_1um - one.true_db for one in thresholds])
    return float(errors.mean()), float(errors.std(ddof=1))

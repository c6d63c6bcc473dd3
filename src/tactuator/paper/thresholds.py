"""Steps 9 and 10: thresholds of simulated observers through the display, and the curve that comes of them.

The chain is the one that a laboratory uses: a protocol, a store, `thresholds` of its runs, and the group's curve.
"""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import tactuator as tt
from tactuator.api.experiment import simulate
from tactuator.arrays import FloatArray
from tactuator.experiment.protocol.file import Protocol, parse_protocol
from tactuator.experiment.result.store_results import group_curve
from tactuator.experiment.result.thresholds import MeasuredThreshold, thresholds
from tactuator.experiment.session.task import Apparatus, SystemClock
from tactuator.experiment.simulated.subjects import Observer, run_study
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import StoredRun, detection_runs
from tactuator.model.controller import Controller
from tactuator.paper.plan import THRESHOLD_HZ, Plan, Progress, observers
from tactuator.perception.curve import ThresholdCurve
from tactuator.perception.psychometric import Weibull
from tactuator.processors import begin_helper, helper_context

_PROTOCOL = """
[study]
name = "thresholds on the display"
seed = {seed}
[procedure]
kind = "imece2004"
start_db_sl = 20.0
[conditions]
fingers = [{fingers}]
frequencies_hz = [{frequencies}]
order = "as-given"
[session]
practice_trials = 0
[[subject]]
code = "{subject}"
"""


@dataclass(frozen=True)
class KnownThreshold:
    """One run's outcome beside the truth, which only a simulated observer has.

    commanded_db_sl: the paper's number (mean of 12 reversals); level_db_re_1um: the same as displacement, by what the
    sensor saw of the stimuli near it; refit_db_re_1um, se_db: the Bayesian refit of the same trials and its standard
    deviation; true_db: the observer's own 79.4 % point.
    """

    observer: str
    channel: str
    frequency_hz: float
    commanded_db_sl: float
    level_db_re_1um: float
    refit_db_re_1um: float
    se_db: float
    true_db: float
    trials: int


@dataclass(frozen=True)
class Detected:
    """Thresholds of all runs, and the group's curve as `experiment thresholds --curve-out` gives it."""

    thresholds: tuple[KnownThreshold, ...]
    curve: ThresholdCurve


@contextmanager
def observers_at_work(plan: Plan, controller: Controller) -> Iterator[Callable[[Progress], Detected]]:
    """Let every observer go through the protocol on the simulated display, beside what else the context does.

    Yield a function that waits for them and returns the thresholds and the curve. Each observer has a store and a
    process of its own; the outcome does not depend on how the work is shared.
    """
    people = observers(plan.display.channels[0].threshold.curve)
    with tempfile.TemporaryDirectory() as folder:
        others = set(multiprocessing.active_children())
        pool = ProcessPoolExecutor(len(people), helper_context(__name__), initializer=begin_helper)
        try:
            stores = {person.name: Path(folder) / f"{person.name}.db" for person in people}
            jobs = {
                pool.submit(run_observer, plan, controller, person, stores[person.name]): person.name
                for person in people
            }

            def detected(progress: Progress) -> Detected:
                runs: dict[str, list[StoredRun]] = {}
                for done, job in enumerate(as_completed(jobs), start=1):
                    job.result()
                    runs[jobs[job]] = _runs(stores[jobs[job]])
                    progress("thresholds", done / len(people))
                return _detected(plan, people, runs)

            yield detected
        except BaseException:  # an interrupted study does not wait until the observers are through
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
            raise
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _detected(plan: Plan, people: Sequence[Observer], runs: Mapping[str, Sequence[StoredRun]]) -> Detected:
    measured = [threshold for person in people for threshold in thresholds(runs[person.name])]
    curves = {person.name: person.curve for person in people}
    channel = plan.display.channels[0]
    curve = group_curve(measured, channel.threshold.curve, channel.threshold.band_hz).curve
    return Detected(tuple(_known(each, curves[each.subject]) for each in measured), curve)


def run_observer(plan: Plan, controller: Controller, observer: Observer, store: Path) -> None:
    """Let one observer go through all runs on every finger, into a store of its own."""
    fingers = ", ".join(f'"{channel.finger}"' for channel in plan.display.channels)
    frequencies = ", ".join(f"{hertz:g}" for hertz in THRESHOLD_HZ)
    seed = plan.seed_of(f"trials of {observer.name}")
    text = _PROTOCOL.format(seed=seed, fingers=fingers, frequencies=frequencies, subject=observer.name)
    rig = tt.SimulatedRig(controller.display, plan.seed_of(f"thresholds of {observer.name}"))
    rig.load(controller)
    loads = controller.display.channels[0].loads
    load = loads[0].name if loads else None
    apparatus = Apparatus(rig, controller, "simulated")
    protocol = parse_protocol(text, Protocol, "the paper's protocol")
    with closing(Store(store, durable=False)) as database:
        run_study(database, protocol, text, apparatus, [observer], SystemClock(), load)


def _runs(path: Path) -> list[StoredRun]:
    with closing(Store(path, must_exist=True)) as store:
        return detection_runs(store)


def _known(measured: MeasuredThreshold, truth: ThresholdCurve) -> KnownThreshold:
    assert measured.own_db_sl is not None
    assert measured.own_level_db_re_1um is not None
    return KnownThreshold(
        observer=measured.subject,
        channel=measured.finger,
        frequency_hz=measured.frequency_hz,
        commanded_db_sl=measured.own_db_sl,
        level_db_re_1um=measured.own_level_db_re_1um,
        refit_db_re_1um=measured.level_db_re_1um,
        se_db=measured.refit_sd_db,
        true_db=float(truth.level_db_re_1um_at(measured.frequency_hz)),
        trials=measured.trials,
    )


def bias_and_spread_db(known: Sequence[KnownThreshold]) -> tuple[float, float]:
    """Return mean and standard deviation of estimate minus truth over all runs."""
    errors: FloatArray = np.array([threshold.level_db_re_1um - threshold.true_db for threshold in known])
    return float(errors.mean()), float(errors.std(ddof=1))


def expected_bias_db(plan: Plan) -> float:
    """Return what is expected of estimate minus truth: the mean of runs of the observers without the display."""
    biases = []
    for person in observers(plan.display.channels[0].threshold.curve):
        model, seed = person.psychometric, plan.seed_of(f"bias of {person.name}")
        assert isinstance(model.shape, Weibull)
        biases.append(simulate(slope=f"{model.shape.slope}", lapse=model.lapse, seed=seed).figures["bias_db"])
    return float(np.mean(biases))

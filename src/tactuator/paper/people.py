"""Thresholds of simulated subjects by the paper's procedure, and the curve that comes of them.

The chain is that of a laboratory with a display for each subject: `experiment observe` of a protocol into a store,
`experiment merge` of the stores, `experiment thresholds`.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import tactuator as tt
from tactuator.api.experiment import merge, observe, simulate
from tactuator.arrays import FloatArray
from tactuator.paper.lab import CONTROLLER
from tactuator.paper.plan import PEOPLE, THRESHOLD_HZ, Plan
from tactuator.perception.curve import ThresholdCurve
from tactuator.processors import begin_helper, helper_context, single_threaded

CURVE = "curve.csv"
_PROTOCOL = """# The paper's procedure, every finger at every frequency once.
[study]
name = "thresholds on the display, {subject}"
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
group = "simulated"
"""

_BIAS_RUNS = 200
"""Runs of each subject, whose mean is then known to 0.05 dB: one digit of it is written."""


@dataclass(frozen=True)
class KnownThreshold:
    """One run's outcome beside the truth, which only a simulated subject has.

    level_db_re_1um: the paper's number, the mean of 12 reversals, as displacement; true_db: the subject's own 79.4 %
    point.
    """

    subject: str
    finger: str
    frequency_hz: float
    level_db_re_1um: float
    true_db: float
    trials: int


@dataclass(frozen=True)
class Detected:
    """Thresholds of all runs; the group's curve; people: of each, as `experiment thresholds` draws it."""

    thresholds: tuple[KnownThreshold, ...]
    curve: ThresholdCurve
    people: tuple[Any, ...]


def write_protocols(plan: Plan, folder: Path) -> None:
    """Write each subject's protocol, and threshold relative to the curve."""
    fingers = ", ".join(f'"{channel.finger}"' for channel in plan.display.channels)
    frequencies = ", ".join(f"{hertz:g}" for hertz in THRESHOLD_HZ)
    hertz = np.geomspace(*plan.display.channels[0].threshold.band_hz, 40)
    for name, (offset_db, tilt_db, _) in PEOPLE.items():
        rows = (f"{f:.6g},{offset_db + tilt_db * np.log10(f / 20.0):.6g}\n" for f in hertz)
        seed = plan.seed_of(f"trials of {name}") % 2**31
        text = _PROTOCOL.format(subject=name, seed=seed, fingers=fingers, frequencies=frequencies)
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
        (folder / f"{name}.csv").write_text("frequency_hz,level_db_sl\n" + "".join(rows), encoding="utf-8")


@contextmanager
def people_at_work(plan: Plan, folder: Path) -> Iterator[Callable[[], Detected]]:
    """Let every subject go through the protocol on a simulated device in a process each, beside what else the context
    does. Yield a function that waits for them and returns the thresholds.
    """
    write_protocols(plan, folder)
    with TemporaryDirectory() as place:
        others = set(multiprocessing.active_children())
        pool = ProcessPoolExecutor(len(PEOPLE), helper_context(__name__), initializer=begin_helper)
        try:
            stores = {name: Path(place) / f"{name}.db" for name in PEOPLE}
            jobs = [pool.submit(run_subject, plan, folder, name, store) for name, store in stores.items()]

            def wait() -> Detected:
                truth = {known: level for job in jobs for known, level in job.result().items()}
                merged = merge([*stores.values()], Path(place) / "all.db").out
                return detected(folder, merged, truth)

            yield wait
        except BaseException:  # an interrupted study does not wait until the subjects are through
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
            raise
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


@single_threaded()
def run_subject(plan: Plan, folder: Path, name: str, store: Path) -> dict[tuple[str, float], float]:
    """Let a subject go through all runs; return the true threshold at each frequency, dB re 1 um."""
    observed = observe(
        folder / f"{name}.toml",
        store,
        tt.SimulatedRig(plan.display, plan.seed_of(f"thresholds of {name}")),
        controller=folder / CONTROLLER,
        truth=[f"{name}={folder / name}.csv"],
        lapse=[f"{name}={PEOPLE[name][2]}"],
        seed=plan.seed_of(f"answers of {name}") % 2**31,
    )
    return {(subject, hertz): level for subject, hertz, level in observed.truth}


def detected(folder: Path, store: Path, truth: dict[tuple[str, float], float]) -> Detected:
    """Return the thresholds beside the truth, and write the group's curve."""
    results = tt.thresholds(store, curve_out=folder / CURVE).results
    known = []
    for each in results.thresholds:
        assert each.own_level_db_re_1um is not None
        true_db = truth[each.subject, each.frequency_hz]
        known.append(
            KnownThreshold(each.subject, each.finger, each.frequency_hz, each.own_level_db_re_1um, true_db, each.trials)
        )
    return Detected(tuple(known), tt.read_curve(folder / CURVE), results.people)


def errors_db(known: tuple[KnownThreshold, ...]) -> FloatArray:
    """Return estimate minus truth of every run, dB."""
    return np.array([each.level_db_re_1um - each.true_db for each in known])


def expected_bias_db(plan: Plan) -> float:
    """Return what is expected of estimate minus truth: the mean of runs of such subjects without the display."""
    biases = [
        simulate(runs=_BIAS_RUNS, slope="2:3", lapse=lapse, seed=plan.seed_of(f"bias of {name}")).figures["bias_db"]
        for name, (_, _, lapse) in PEOPLE.items()
    ]
    return float(np.mean(biases))


def over_fingers(known: tuple[KnownThreshold, ...]) -> dict[str, FloatArray]:
    """Return each subject's level at each frequency, the mean over the fingers, (frequencies, 2): Hz, dB re 1 um."""
    return {
        name: np.array([(hertz, np.mean(_levels(known, name, hertz))) for hertz in THRESHOLD_HZ]) for name in PEOPLE
    }


def standard_error_db(known: tuple[KnownThreshold, ...]) -> float:
    """Return the standard error of such a mean, from the scatter over the fingers, pooled over all means."""
    groups = [_levels(known, name, hertz) for name in PEOPLE for hertz in THRESHOLD_HZ]
    return float(np.sqrt(np.mean([np.var(levels, ddof=1) / levels.size for levels in groups])))


def _levels(known: tuple[KnownThreshold, ...], subject: str, hertz: float) -> FloatArray:
    return np.array([each.level_db_re_1um for each in known if (each.subject, each.frequency_hz) == (subject, hertz)])

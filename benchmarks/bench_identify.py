"""Identification: a minute's records at 4 kHz, beside an output-error fit written with scipy; and the recursion alone.

The record is of the simulated display's motor (friction, hum, noise, converters). The peer fits the same three
coefficients to the same record by `scipy.optimize.least_squares` around `scipy.signal.lfilter`, without friction, hum,
order or confidence. Two more records, of a resonator whose command is held or band-limited, are identified with the
hold known, with the hold left to the data, and with eight poles; beside their seconds stands the ratio to the peer's
for three parameters. Times are of this process's own work (processor time); set OPENBLAS_NUM_THREADS=1 for one core.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy import optimize, signal

from tactuator.identification.identify import identify
from tactuator.identification.recursive import recursive_least_squares
from tactuator.model.description import Channel, Display
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.excitation import paper_mix
from tactuator.signals.record import Record
from tactuator.signals.systems import ContinuousSystem

RATE_HZ = 4000.0
MOTOR = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])
RESONATOR = ContinuousSystem.from_polynomials([4e5], [1.0, 85.0, 1.9e5])
GUESS = np.array([2500.0, 80.0, 250.0])
BAND_HZ = np.geomspace(0.4, 300.0, 500)


def record() -> Record:
    channel = Channel("index", 0.19898, 12.5, MOTOR)
    command = paper_mix(60.0, RATE_HZ, 10.0, np.random.default_rng(0), plant=MOTOR, travel_v=2.4)
    trace = SimulatedRig(Display(RATE_HZ, (channel,), 1, "paper"), 3).drive(command[:, None])
    return Record(RATE_HZ, trace.command_v[:, 0], trace.position_v[:, 0])


def resonator(between: str) -> Record:
    """A minute of a resonator at 69 Hz under white noise, its command held or band-limited, with noise 40 dB down."""
    rng = np.random.default_rng(5)
    count = round(60.0 * RATE_HZ)
    command = rng.standard_normal(count)
    frequency = np.fft.rfftfreq(count, 1.0 / RATE_HZ)
    if between == "band-limited":
        lines = np.fft.rfft(command) * (frequency < 0.4 * RATE_HZ)
        command = np.fft.irfft(lines, count)
        position = np.fft.irfft(lines * RESONATOR.response(frequency), count)
    else:
        b, a, _ = signal.cont2discrete(RESONATOR.polynomials(), 1.0 / RATE_HZ)
        position = signal.lfilter(b[0], a, command)
    return Record(RATE_HZ, command, position + 0.01 * np.std(position) * rng.standard_normal(count))


def spectral() -> dict[str, object]:
    """Return processor seconds of each way to identify the two resonators, and over the peer's."""
    figures: dict[str, object] = {}
    for between in ("zero-order", "band-limited"):
        taken = resonator(between)
        peer_s, _ = best_cpu_s(partial(peer, taken, np.array([4e5, 80.0, 1.8e5])), 1)
        ways: dict[str, dict[str, Any]] = {
            "known": {"hold": between},
            "told": {},
            "eight": {"hold": between, "order": 8},
        }
        for name, wishes in ways.items():
            own_s, found = best_cpu_s(partial(identify, taken, **wishes), 2)
            value = found.model.response(BAND_HZ) / RESONATOR.response(BAND_HZ)
            figures[f"{between}.{name}"] = {
                "seconds": own_s,
                "over_peer": own_s / peer_s,
                "worst_error_db": float(np.max(np.abs(20.0 * np.log10(np.abs(value))))),
            }
    return figures


def best_cpu_s(work: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Processor seconds of the quickest of several runs, and what the last one gave."""
    times, result = [], None
    for _ in range(repeats):
        start = time.process_time()
        result = work()
        times.append(time.process_time() - start)
    return min(times), result


def peer(
    taken: Record, guess: np.ndarray[tuple[int], np.dtype[np.float64]] = GUESS
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Output error with scipy: num, a1, a0."""

    def residual(theta: Any) -> Any:
        b, a, _ = signal.cont2discrete(
            ([guess[0] * theta[0]], [1.0, guess[1] * theta[1], guess[2] * theta[2]]), 1 / RATE_HZ
        )
        left = taken.position - signal.lfilter(b[0], a, taken.command)
        return left - left.mean()

    return np.asarray(optimize.least_squares(residual, np.ones(3)).x * guess)


def worst_db(num: Any, den: Any) -> float:
    s = 2j * np.pi * BAND_HZ
    value = np.polyval(num, s) / np.polyval(den, s)
    return float(np.max(np.abs(20.0 * np.log10(np.abs(value / MOTOR.response(BAND_HZ))))))


def run() -> dict[str, object]:
    taken = record()
    rows = np.random.default_rng(1).standard_normal((1_000_000, 3))
    output = rows @ np.ones(3)
    refined_s, found = best_cpu_s(lambda: identify(taken), 3)
    rls_s, plain = best_cpu_s(lambda: identify(taken, method="rls"), 3)
    peer_s, theta = best_cpu_s(lambda: peer(taken), 2)
    recursion_s, _ = best_cpu_s(lambda: recursive_least_squares(rows, output), 3)
    return {
        "refined": {"seconds": refined_s, "worst_error_db": worst_db(found.model.num, found.model.den)},
        "recursive": {"seconds": rls_s, "worst_error_db": worst_db(plain.model.num, plain.model.den)},
        "scipy_output_error": {"seconds": peer_s, "worst_error_db": worst_db(theta[:1], np.append(1.0, theta[1:]))},
        "spectral": spectral(),
        "friction_v": found.friction.coulomb if found.friction is not None else 0.0,
        "recursion_million_samples_per_s": 1.0 / recursion_s,
        "goals": {"seconds": 2.0, "recursion_million_samples_per_s": 2.0},
    }

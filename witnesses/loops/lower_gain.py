"""Draws plants with integrators, delays and modes, has a loop designed for each, and runs every loop at lower gains.

No loop may grow at any gain from 1 down to 0.001, nor swing on where its command is cut at the converter's range, after
a kick of ten times that range. Shared with the program: the display file it reads, and the figures of
`controller.json`. Not shared: the plants, their hold and the runs in time (NumPy and SciPy alone). A run of 2^24 ticks
at a lower gain is the loop's state matrix squared 24 times; the run with a cut command has the back-calculation of the
file and not the core's conditioning. Seen to fail with `--broken`, the loop that was delivered for 35530/(s^2 + 50 s)
while lower gains were tried at four values only.
"""

from __future__ import annotations

import argparse
import sys
import time
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal

import tactuator as tt
from tactuator.errors import BadInput, NoDesign
from tactuator.io.display import parse_display

Array = NDArray[np.float64]
GAINS = np.geomspace(1.0, 1e-3, 61)
DOUBLINGS, RUNS_AWAY = 24, 1e60
BROKEN_SOS = [
    [63.60721082134155, -58.77805202676031, 0.32940675254672513, 1.0, -0.7719195183099326, 0.1782869563745635],
    [0.3452470058240882, -0.06622403964287878, 0.048284071192638375, 1.0, -0.9054902935455377, 0.23279733091938543],
    [1.0, -1.985126903601984, 0.985278521800471, 1.0, -1.9332321717089371, 0.9332321717089371],
]

TABLE = """
[display]
name = "drawn"
rate_hz = {rate_hz}
delay_samples = {delay}
[threshold]
band_hz = [0.4, 300.0]
[[channel]]
name = "drawn"
sensor_gain_v_per_mm = 0.2
travel_mm = 12.5
plant = {{ zeros = [], poles = {poles}, gain = {gain!r}, delay_s = {dead_s!r} }}
"""


@dataclass(frozen=True)
class Drawn:
    """A plant gain / prod(s - poles) e^(-s dead_s) (rad/s), with the rate and the delay of its processor."""

    kind: str
    poles: tuple[complex, ...]
    gain: float
    dead_s: float
    rate_hz: float
    delay: int

    def display(self) -> str:
        """Return the display file."""
        poles = [[pole.real, pole.imag] for pole in self.poles]
        return TABLE.format(rate_hz=self.rate_hz, delay=self.delay, poles=poles, gain=self.gain, dead_s=self.dead_s)

    def held(self) -> tuple[Array, Array, Array]:
        """Return (A, b, c) of the plant from held command to reading, its dead time and the processor's delay in it."""
        a, b, c, _ = signal.zpk2ss([], self.poles, self.gain)
        a, b, c = _balanced(np.real(a), np.real(b)[:, 0], np.real(c)[0])
        step = 1.0 / self.rate_hz
        whole, rest = divmod(self.dead_s, step)
        old, fresh = _integral(a, b, step - rest, step), _integral(a, b, 0.0, step - rest)
        order, count = a.shape[0], 1 + int(whole) + self.delay
        big = np.zeros((order + count, order + count))
        big[:order, :order] = linalg.expm(a * step)
        big[:order, order], into = old, np.zeros(order + count)
        if count > 1:
            big[:order, order + 1] = fresh
            big[order : order + count - 1, order + 1 :] += np.eye(count - 1)
            into[-1] = 1.0
        else:
            into[:order], into[order] = fresh, 1.0
        return big, into, np.concatenate([c, np.zeros(count)])


def _balanced(a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
    balanced, scale = linalg.matrix_balance(a, permute=False, separate=True)
    return balanced, b / scale[0], c * scale[0]


def _integral(a: Array, b: Array, start: float, end: float) -> Array:
    """Return the integral of expm(a t) b over t from start to end."""
    order = a.shape[0]
    block = np.zeros((order + 1, order + 1))
    block[:order, :order], block[:order, order] = a, b
    return np.asarray(linalg.expm(block * end)[:order, order] - linalg.expm(block * start)[:order, order])


def draw(rng: np.random.Generator) -> Drawn:
    """Return a plant: a motor with a spring or none, or a resonator; with another mode and dead time, or without."""
    kind = str(rng.choice(["integrator", "motor", "resonator"]))
    if kind == "integrator":
        poles: list[complex] = [0.0, -float(np.exp(rng.uniform(np.log(5.0), np.log(400.0))))]
    elif kind == "motor":
        poles = [complex(-np.exp(rng.uniform(np.log(low), np.log(high)))) for low, high in ((1.0, 20.0), (40.0, 400.0))]
    else:
        poles = _mode(rng, 15.0, 250.0, 0.02, 0.5)
    if rng.random() < 0.4:
        poles += _mode(rng, 200.0, 900.0, 0.01, 0.2)
        kind += ", mode"
    rate_hz = float(rng.choice([2000.0, 4000.0, 8000.0, 16000.0]))
    dead_s = float(rng.choice([0.0, rng.uniform(0.0, 1.0e-3)]))
    kind += ", dead time" if dead_s else ""
    at = 2j * np.pi * np.exp(rng.uniform(np.log(5.0), np.log(60.0)))
    gain = float(abs(np.prod([at - pole for pole in poles])))
    return Drawn(kind, tuple(poles), gain, dead_s, rate_hz, int(rng.integers(1, 3)))


def _mode(rng: np.random.Generator, low_hz: float, high_hz: float, least: float, most: float) -> list[complex]:
    natural = 2.0 * np.pi * np.exp(rng.uniform(np.log(low_hz), np.log(high_hz)))
    damping = np.exp(rng.uniform(np.log(least), np.log(most)))
    pole = complex(natural * (-damping + 1j * np.sqrt(1.0 - damping**2)))
    return [pole, pole.conjugate()]


def _controlled(sos: Sequence[Sequence[float]]) -> tuple[Array, Array, Array, float]:
    """Return (A, b, c, d) of the sections in a row."""
    a, b, c, d = np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0
    for b0, b1, b2, _, a1, a2 in sos:
        own, drive, out = (
            np.array([[-a1, 1.0], [-a2, 0.0]]),
            np.array([b1 - a1 * b0, b2 - a2 * b0]),
            np.array([1.0, 0.0]),
        )
        a = np.block([[a, np.zeros((a.shape[0], 2))], [np.outer(drive, c), own]])
        b, c, d = np.concatenate([b, drive * d]), np.concatenate([c * b0, out]), d * b0
    return a, b, c, d


def grows_at(plant: Drawn, sos: Sequence[Sequence[float]]) -> float:
    """Return the greatest of GAINS at which the loop grows in a run of 2^24 periods; 0.0 where it grows at none."""
    (a, b, c), (ca, cb, cc, cd) = plant.held(), _controlled(sos)
    for gain in GAINS.tolist():
        run = np.block([[a - gain * cd * np.outer(b, c), gain * np.outer(b, cc)], [-np.outer(cb, c), ca]])
        run = linalg.matrix_balance(run, permute=False)[0]
        sizes = [1.0]
        for _ in range(DOUBLINGS):
            run = run @ run
            sizes.append(float(np.max(np.abs(run))))
            if not sizes[-1] < RUNS_AWAY:
                break
        if not sizes[-1] < RUNS_AWAY or sizes[-1] > 2.0 * sizes[-3]:  # what dies out has its greatest swing early
            return float(gain)
    return 0.0


def left_of_a_kick(
    plant: Drawn, sos: Sequence[Sequence[float]], gains: tuple[float, float], range_v: float = 10.0
) -> float:
    """Return the greatest reading of the last tenth of a run over that of its first half, after a kick that holds the
    command at its limit: the motor is pushed for a while by ten times what it can give."""
    a, b, c = plant.held()
    count = int(6.0 * plant.rate_hz)
    x, states, readings = np.zeros(b.size), np.zeros((len(sos), 2)), np.zeros(count)
    for tick in range(count):
        readings[tick] = y = float(c @ x)
        value = -y
        for index, (b0, b1, b2, _, a1, a2) in enumerate(sos):
            first, second = states[index]
            out = b0 * value + first
            states[index] = second + b1 * value - a1 * out, b2 * value - a2 * out
            value = out
        cut = min(max(value, -range_v), range_v)
        # the gains are of the form in d = z - 1: s1 there is s1 here, s2 there is s1 + s2 here
        states[-1] += (gains[0] * (cut - value), (gains[1] - gains[0]) * (cut - value))
        x = a @ x + b * (cut + (10.0 * range_v if tick < 0.02 * plant.rate_hz else 0.0))
    half, last = np.max(np.abs(readings[: count // 2])), np.max(np.abs(readings[-count // 10 :]))
    return float(last / half)


def run(count: int, seed: int) -> Iterator[tuple[Drawn, float, float, float]]:
    """Yield `count` plants for which a loop is delivered, the greatest gain at which it grows, what is left of a kick
    and the seconds of the design."""
    rng = np.random.default_rng(seed)
    while count:
        plant = draw(rng)
        begun = time.perf_counter()
        try:
            controller = tt.design(parse_display(tomllib.loads(plant.display())))
        except (BadInput, NoDesign):
            continue
        seconds = time.perf_counter() - begun
        (channel,) = controller.channels
        sos = np.asarray(channel.feedback_sos).tolist()
        count -= 1
        yield plant, grows_at(plant, sos), left_of_a_kick(plant, sos, channel.anti_windup.gains), seconds


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--broken", action="store_true", help="the loop that was once delivered for 35530/(s^2 + 50 s)")
    asked = parser.parse_args()
    if asked.broken:
        grows = grows_at(Drawn("integrator", (0.0, -50.0), 35530.0, 0.0, 8000.0, 1), BROKEN_SOS)
        print(f"the loop of old grows at {grows:.3g} of its gain")
        return 0 if grows == 0.0 else 1
    wrong = 0
    for number, (plant, grows, left, seconds) in enumerate(run(asked.count, asked.seed)):
        wrong += grows > 0.0 or left > 0.05
        poles = ", ".join(f"{pole:.4g}" for pole in plant.poles)
        print(
            f"{number:3} {plant.kind:28} {plant.rate_hz:6g} Hz, {plant.delay} + {1e3 * plant.dead_s:.2f} ms  grows at "
            f"{grows:.3g}  left of a kick {left:.1e}  {seconds:5.1f} s  [{poles}]",
            flush=True,
        )
    print(f"{wrong} of {asked.count} loops grow at a lower gain or swing on after a kick")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

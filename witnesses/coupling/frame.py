"""A display of the witness's own: three movers on a frame of finite mass on springs, simulated step by step.

Each mover stands on the frame by its own spring and damper, its motor pushes between the two, and its sensor sits on
the frame. The frame therefore moves against every motor, and with it the feet of all the others: nothing here is a
"share". Converters of 16 bits, sensor noise, Dahl friction between mover and frame, and one sample of computing.

    q_i'' = b_i u_i - d_i q_i' - k_i q_i - g_i x''      (volts of sensor i)
    M x'' = -B x' - K x - sum_j (b_j u_j - d_j q_j' - k_j q_j) / g_j      (mm)
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize

Array = NDArray[np.float64]
RATE_HZ, RANGE_V, STEP_V = 4000.0, 10.0, 20.0 / 65536.0
NAMES = ("left", "centre", "right")
GAIN_V_PER_MM = np.array([0.21, 0.19, 0.20])
MOTOR, DAMPING, STIFFNESS = np.array([[2900.0, 2600.0, 3100.0], [90.0, 104.0, 85.0], [300.0, 320.0, 280.0]])
FRAME_HZ, FRAME_DAMPING = 45.0, 0.2
FRICTION_V, PRESLIDING_V, NOISE_V = 0.004, 0.010, 0.0002


def matrices(mass: float) -> tuple[Array, Array]:
    """Return A (8, 8) and B (8, 3) of the whole mechanism; the frame weighs `mass` times a mover."""
    count, omega = 3, 2.0 * np.pi * FRAME_HZ
    a, b = np.zeros((8, 8)), np.zeros((8, 3))
    a[:3, 3:6], a[6, 7] = np.eye(count), 1.0
    a[7, :3], a[7, 3:6] = STIFFNESS / GAIN_V_PER_MM / mass, DAMPING / GAIN_V_PER_MM / mass
    a[7, 6:], b[7] = [-(omega**2), -2.0 * FRAME_DAMPING * omega], -MOTOR / GAIN_V_PER_MM / mass
    a[3:6, :3], a[3:6, 3:6], b[3:6] = -np.diag(STIFFNESS), -np.diag(DAMPING), np.diag(MOTOR)
    a[3:6] -= np.outer(GAIN_V_PER_MM, a[7])
    b[3:6] -= np.outer(GAIN_V_PER_MM, b[7])
    return a, b


def held(mass: float) -> tuple[Array, Array]:
    """Return the matrices from sample to sample, the command held."""
    block = np.zeros((11, 11))
    block[:8, :8], block[:8, 8:] = matrices(mass)
    whole = linalg.expm(block / RATE_HZ)
    return whole[:8, :8], whole[:8, 8:]


def responses(mass: float, frequency_hz: Array) -> NDArray[np.complex128]:
    """Return the responses from every command to every sensor, (m, out, in)."""
    a, b = held(mass)
    z = np.exp(2j * np.pi * frequency_hz / RATE_HZ)
    return np.stack([(np.linalg.solve(at * np.eye(8) - a, b.astype(complex)))[:3] for at in z])


def shares(mass: float, frequency_hz: Array) -> NDArray[np.complex128]:
    """Return G_ij / G_ii off the diagonal, (m, out, in)."""
    whole = responses(mass, frequency_hz)
    return np.asarray((1.0 - np.eye(3)) * whole / np.einsum("mii->mi", whole)[:, :, None])


def mass_for(level_db: float) -> float:
    """Return the frame's mass for which the greatest share from 2 to 250 Hz is of this level."""
    grid = np.geomspace(2.0, 250.0, 400)

    def excess(log_mass: float) -> float:
        return float(20.0 * np.log10(np.max(np.abs(shares(np.exp(log_mass), grid)))) - level_db)

    return float(np.exp(optimize.brentq(excess, np.log(2.0), np.log(1e6))))


@dataclass
class Fingers:
    """The display, from rest. friction_v: Coulomb level in volts of command."""

    mass: float
    seed: int
    friction_v: float = FRICTION_V
    x: Array = field(default_factory=lambda: np.zeros(8))

    def __post_init__(self) -> None:
        self.a, self.b = held(self.mass)
        self.rng = np.random.default_rng(self.seed)
        self.rubbed_v, self.stood_v = np.zeros(3), np.zeros(3)

    def step(self, command_v: Array) -> None:
        """Let one sample pass under commands (3,), volts, as the D/A has them."""
        put_out_v = np.round(np.clip(command_v, -RANGE_V, RANGE_V) / STEP_V) * STEP_V
        way = self.x[:3] - self.stood_v
        self.rubbed_v = (self.rubbed_v + self.friction_v / PRESLIDING_V * way) / (1.0 + np.abs(way) / PRESLIDING_V)
        self.stood_v = self.x[:3].copy()
        self.x = self.a @ self.x + self.b @ (put_out_v - self.rubbed_v)

    def read(self) -> Array:
        """Return what the A/D reads, (3,), volts."""
        return np.asarray(np.round((self.x[:3] + self.rng.normal(0.0, NOISE_V, 3)) / STEP_V) * STEP_V)


def write_record(path: Path, mass: float, seed: int, period_s: float, experiments: int) -> None:
    """Write a record of all three fingers at once, as the program's page on files describes one: multisines of random
    phases on the same odd lines, new ones on every finger in every experiment, each for three periods."""
    rng, period, repeats = np.random.default_rng(seed), round(period_s * RATE_HZ), 3
    wanted = np.geomspace(1.0, 300.0, 110) * period_s
    lines = np.unique(2 * np.round(0.5 * (wanted - 1.0)).astype(int) + 1)
    off = np.abs(lines / period_s - 60.0 * np.round(lines / period_s / 60.0))
    lines = lines[(off > 1.0) | (lines / period_s < 30.0)]
    size = np.sqrt(lines / period_s / 10.0 + 0.2)
    spectrum = np.zeros((experiments, 3, period // 2 + 1), dtype=complex)
    spectrum[:, :, lines] = size * np.exp(2j * np.pi * rng.uniform(size=(experiments, 3, lines.size)))
    waves = np.fft.irfft(spectrum, period)
    waves *= 7.0 / np.max(np.abs(waves), axis=(0, 2), keepdims=True)
    command = np.concatenate([np.tile(wave.T, (repeats, 1)) for wave in waves])
    command = np.round(command / STEP_V) * STEP_V
    fingers, position = Fingers(mass, seed), np.empty_like(command)
    for row, volts in enumerate(command):
        position[row] = fingers.read()
        fingers.step(volts)
    with h5py.File(path, "w") as file:
        attributes = {"rate_hz": RATE_HZ, "hold": "zero-order", "channels": "\n".join(NAMES)}
        plan = {"period_samples": period, "periods": repeats, "realisations": experiments}
        for key, value in (attributes | plan | {"excited_lines": " ".join(map(str, lines))}).items():
            file.attrs[key] = value if isinstance(value, float) else str(value)
        for name, values in (("command", command), ("position", position)):
            file.create_dataset(name, data=values)
            file[name].attrs["unit"] = "V"


class Filter:
    """Second-order sections, one after the other, in transposed direct form II."""

    def __init__(self, sections: Sequence[Sequence[float]]) -> None:
        self.sections = [[c / row[3] for c in row] for row in sections]
        self.states = [[0.0, 0.0] for _ in sections]

    def step(self, value: float) -> float:
        """Return the answer to the next sample."""
        for (b0, b1, b2, _, a1, a2), state in zip(self.sections, self.states, strict=True):
            answer = b0 * value + state[0]
            state[0] = b1 * value - a1 * answer + state[1]
            state[1] = b2 * value - a2 * answer
            value = answer
        return value


def felt_v(controller: Path, mass: float, driver: int, peak: float, frequency_hz: float, seed: int) -> Array:
    """Return the motion of all fingers, peak volts at ideal sensors, (3,), while one follows a sinusoid of `peak`
    threshold units under the sections of a controller file."""
    channels = json.loads(controller.read_text())["channels"]
    prefilters, loops = ([Filter(each[key]) for each in channels] for key in ("prefilter_sos", "feedback_sos"))
    fingers, held_v = Fingers(mass, seed), np.zeros(3)
    settle = round(2.0 * RATE_HZ)
    count = settle + round(max(1, round(2.0 * frequency_hz)) / frequency_hz * RATE_HZ)
    angle = 2.0 * np.pi * frequency_hz / RATE_HZ * np.arange(count)
    moved = np.empty((count, 3))
    for row, wanted in enumerate(peak * np.sin(angle)):
        read_v, moved[row] = fingers.read(), fingers.x[:3]
        asked = [prefilters[place].step(wanted if place == driver else 0.0) for place in range(3)]
        next_v = np.array([loops[place].step(asked[place] - read_v[place]) for place in range(3)])
        fingers.step(held_v)
        held_v = next_v
    columns = np.stack([np.sin(angle[settle:]), np.cos(angle[settle:]), np.ones(count - settle)], axis=1)
    return np.asarray(np.hypot(*np.linalg.lstsq(columns, moved[settle:], rcond=None)[0][:2]))

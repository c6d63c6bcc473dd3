"""What `tactuator identify` says of 43 spoilt records: status 0 only where the told band holds the error.

The mechanisms (a motor on a spring, a voice coil, a resonator), the excitations and the faults are made here with NumPy
and SciPy alone; nothing of the project is in them. The held command drives an exact discretisation in sub-steps, which
another clock reads between its steps. A record is wrong where it is trusted and its response departs from the truth by
more than the band and 0.1 dB, or the band and the 0.67 degrees that turn it as far, at a frequency that the model calls
valid. One that is refused (status 2) or not trusted (1) is told, as it should be. Truth is the response at small
commands, at the record's beginning and at its end: where the gain falls, both count. Seen to fail: a held command at
two clocks, play, even samples whose stamps alone jitter, every third sample of white noise (12 dB off) and a cubic
sensor were trusted once.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate, signal

import tactuator as tt
from tactuator.errors import BadInput
from tactuator.identification.result import Identification

Array = NDArray[np.float64]
RATE_HZ = 4000.0
SUB = 8
"""Sub-steps of a sample in which the mechanism is followed."""
MATERIAL_DB = 0.1
MATERIAL_DEG = float(np.degrees(10.0 ** (MATERIAL_DB / 20.0) - 1.0))


@dataclass(frozen=True)
class Mechanism:
    """A linear mechanism: numerator and denominator, descending powers of s in rad/s, and a dead time, seconds."""

    name: str
    num: tuple[float, ...]
    den: tuple[float, ...]
    dead_s: float

    def response(self, hertz: Array) -> NDArray[np.complex128]:
        """Return the response at frequencies (m,)."""
        s = 2j * np.pi * hertz
        return np.asarray(np.polyval(self.num, s) / np.polyval(self.den, s) * np.exp(-s * self.dead_s))

    def moved(self, command: Array, rate_hz: float) -> Array:
        """Return the position in sub-steps, (SUB n,), for a command (n,) that is held; the dead time is whole
        sub-steps."""
        system = signal.cont2discrete((self.num, self.den), 1.0 / (SUB * rate_hz), method="zoh")
        held = np.repeat(command, SUB)
        late = round(self.dead_s * rate_hz * SUB)
        return np.asarray(signal.lfilter(np.ravel(system[0]), system[1], np.concatenate([np.zeros(late), held])))[
            : held.size
        ]


def _pair(hertz: float, ratio: float) -> Array:
    omega = 2.0 * np.pi * hertz
    return np.array([1.0, 2.0 * ratio * omega, omega**2])


def _mechanism(name: str, gain: float, factors: list[Array], dead_s: float) -> Mechanism:
    den: Array = np.ones(1)
    for factor in factors:
        den = np.asarray(np.polymul(den, factor), dtype=np.float64)
    return Mechanism(name, (gain * float(den[-1]),), tuple(den.tolist()), dead_s)


MOTOR = _mechanism("motor", 0.8, [_pair(22.0, 0.75)], 0.5e-3)
COIL = _mechanism("coil", 2.0, [_pair(65.0, 0.35), np.array([1.0, 2.0 * np.pi * 700.0])], 0.25e-3)
RESONATOR = _mechanism("resonator", 0.05, [_pair(175.0, 1.0 / 24.0)], 0.0)


def white(count: int, rng: np.random.Generator) -> Array:
    """Return a white Gaussian command (count,)."""
    return rng.standard_normal(count)


def multisine(count: int, rng: np.random.Generator) -> Array:
    """Return a sum of 400 sines of random phases, 1 to 600 Hz."""
    hertz = np.geomspace(1.0, 600.0, 400)
    t, phase = np.arange(count) / RATE_HZ, rng.uniform(0.0, 2.0 * np.pi, hertz.size)
    total = np.zeros(count)
    for f, p in zip(hertz, phase, strict=True):
        total += np.sin(2.0 * np.pi * f * t + p)
    return total / np.std(total)


def chirp(count: int, rng: np.random.Generator) -> Array:
    """Return a sine that sweeps from 2 to 600 Hz, evenly in log frequency."""
    t = np.arange(count) / RATE_HZ
    return np.asarray(
        np.sqrt(2.0) * signal.chirp(t, 2.0, t[-1], 600.0, method="logarithmic", phi=float(rng.uniform(0.0, 360.0)))
    )


def binary(count: int, rng: np.random.Generator) -> Array:
    """Return a random binary command that may change every fourth sample."""
    return np.repeat(np.sign(rng.standard_normal(count // 4 + 1)), 4)[:count]


@dataclass(frozen=True)
class Taken:
    """What a laboratory's file holds: stamps, command and position, (n,); truth: gains of the true response that
    count."""

    time_s: Array
    command: Array
    position: Array
    gains: tuple[float, ...] = (1.0,)


@dataclass(frozen=True)
class Spoilt:
    """A record to be made: its mechanism, excitation, seconds, noise below the position in dB, and its fault."""

    name: str
    mechanism: Mechanism
    excitation: Callable[[int, np.random.Generator], Array]
    fault: Callable[[Taken, Array, np.random.Generator], Taken]
    seconds: float = 15.0
    noise_db: float = 50.0
    amplifier: Callable[[Array], Array] = lambda u: u
    rate_hz: float = RATE_HZ

    def make(self, seed: int) -> Taken:
        """Return the record."""
        rng = np.random.default_rng(seed)
        count = round(self.seconds * self.rate_hz)
        command = self.excitation(count, rng)
        fine = self.mechanism.moved(self.amplifier(command), self.rate_hz)
        clean = Taken(np.arange(count) / self.rate_hz, command, fine[::SUB].copy())
        taken = self.fault(clean, fine, rng)
        noise = 10.0 ** (-self.noise_db / 20.0) * float(np.std(clean.position))
        return replace(taken, position=taken.position + noise * rng.standard_normal(taken.position.size))


def _cut(taken: Taken, u: Array, y: Array) -> Taken:
    count = min(u.size, y.size)
    return replace(taken, time_s=taken.time_s[:count], command=u[:count], position=y[:count])


def lose(*blocks: tuple[float, int], of: str = "position") -> Callable[[Taken, Array, np.random.Generator], Taken]:
    """Return the fault that loses blocks (place as a share of the record, samples) of one column, or of both."""

    def spoil(taken: Taken, _: Array, rng: np.random.Generator) -> Taken:
        keep = np.ones(taken.command.size, dtype=bool)
        for place, many in blocks:
            begin = round(place * taken.command.size) + int(rng.integers(0, 97))
            keep[begin : begin + many] = False
        u, y = taken.command, taken.position
        return _cut(taken, u[keep] if of in ("command", "both") else u, y[keep] if of in ("position", "both") else y)

    return spoil


def skew(ppm: float) -> Callable[[Taken, Array, np.random.Generator], Taken]:
    """Return the fault of a position that is read by a clock of its own, slower by so many millionths."""

    def spoil(taken: Taken, fine: Array, _: np.random.Generator) -> Taken:
        place = np.arange(taken.command.size) * (1.0 + 1e-6 * ppm) * SUB
        place = place[place < fine.size - 4]
        read = interpolate.make_interp_spline(np.arange(fine.size), fine, k=5)(place)
        return _cut(taken, taken.command, np.asarray(read))

    return spoil


def fall(share: float) -> Callable[[Taken, Array, np.random.Generator], Taken]:
    """Return the fault of a gain that falls evenly by a share over the record."""

    def spoil(taken: Taken, _: Array, __: np.random.Generator) -> Taken:
        gain = 1.0 - share * np.linspace(0.0, 1.0, taken.position.size)
        return replace(taken, position=gain * taken.position, gains=(1.0, 1.0 - share))

    return spoil


def jitter(share: float, *, true: bool) -> Callable[[Taken, Array, np.random.Generator], Taken]:
    """Return the fault of uneven stamps, by up to a share of a step; true: the position is
    read at the stamped time, else the samples are even and the stamps alone are late."""

    def spoil(taken: Taken, fine: Array, rng: np.random.Generator) -> Taken:
        count = taken.command.size
        away = share * rng.uniform(-1.0, 1.0, count)
        away[0] = away[-1] = 0.0
        y = taken.position
        if true:
            place = np.clip((np.arange(count) + away) * SUB, 0, fine.size - 1)
            y = np.asarray(interpolate.make_interp_spline(np.arange(fine.size), fine, k=5)(place))
        return replace(taken, time_s=taken.time_s + away / RATE_HZ, position=y)

    return spoil


def backlash(share: float) -> Callable[[Taken, Array, np.random.Generator], Taken]:
    """Return the fault of a sensor with play, its width a share of the position's standard deviation."""

    def spoil(taken: Taken, fine: Array, _: np.random.Generator) -> Taken:
        half = 0.5 * share * float(np.std(fine))
        out, now = np.empty(fine.size), float(fine[0])
        for k, value in enumerate(fine.tolist()):
            now = min(max(now, value - half), value + half)
            out[k] = now
        return replace(taken, position=out[::SUB])

    return spoil


def cubic(share: float) -> Callable[[Taken, Array, np.random.Generator], Taken]:
    """Return the fault of a sensor with a share of the position's cube, in its standard deviations."""

    def spoil(taken: Taken, _: Array, __: np.random.Generator) -> Taken:
        size = float(np.std(taken.position))
        return replace(taken, position=taken.position + share * size * (taken.position / size) ** 3)

    return spoil


def swap(taken: Taken, _: Array, __: np.random.Generator) -> Taken:
    """Swap the columns."""
    return replace(taken, command=taken.position, position=taken.command)


def decimate(many: int) -> Callable[[Taken, Array, np.random.Generator], Taken]:
    """Return the fault of keeping every so-manyth sample without a filter."""

    def spoil(taken: Taken, _: Array, __: np.random.Generator) -> Taken:
        return replace(
            taken, time_s=taken.time_s[::many], command=taken.command[::many], position=taken.position[::many]
        )

    return spoil


def none(taken: Taken, _: Array, __: np.random.Generator) -> Taken:
    """Leave the record as it is."""
    return taken


def tanh(level: float) -> Callable[[Array], Array]:
    """Return an amplifier that saturates softly at so many standard deviations."""
    return lambda u: np.asarray(level * np.tanh(u / level))


def clip(level: float) -> Callable[[Array], Array]:
    """Return an amplifier that clips at so many standard deviations."""
    return lambda u: np.clip(u, -level, level)


def dead(level: float) -> Callable[[Array], Array]:
    """Return an amplifier with a dead zone of so many standard deviations to either side."""
    return lambda u: np.asarray(u - np.clip(u, -level, level))


RECORDS = (
    Spoilt("1 sample lost", MOTOR, white, lose((0.5, 1))),
    Spoilt("2 samples lost, chirp", COIL, chirp, lose((0.6, 2))),
    Spoilt("4 samples lost", COIL, multisine, lose((0.3, 4))),
    Spoilt("16 samples lost", MOTOR, white, lose((0.5, 16)), noise_db=40.0),
    Spoilt("16 samples lost, chirp", COIL, chirp, lose((0.5, 16))),
    Spoilt("64 samples lost", COIL, white, lose((0.7, 64))),
    Spoilt("64 samples lost, binary", MOTOR, binary, lose((0.2, 64)), noise_db=60.0),
    Spoilt("64 samples lost, resonator", RESONATOR, white, lose((0.4, 64))),
    Spoilt("256 samples lost", MOTOR, multisine, lose((0.5, 256)), noise_db=60.0),
    Spoilt("1000 samples lost", COIL, white, lose((0.8, 1000)), noise_db=40.0),
    Spoilt("1000 samples lost, chirp", COIL, chirp, lose((0.7, 1000))),
    Spoilt("3 blocks lost", MOTOR, white, lose((0.2, 7), (0.5, 40), (0.8, 3))),
    Spoilt("2 blocks lost, resonator", RESONATOR, multisine, lose((0.35, 120), (0.75, 30)), noise_db=40.0),
    Spoilt("30 samples of the command lost", COIL, white, lose((0.5, 30), of="command")),
    Spoilt("5 samples of the command lost", MOTOR, multisine, lose((0.6, 5), of="command"), noise_db=60.0),
    Spoilt("200 samples of both lost", COIL, white, lose((0.5, 200), of="both")),
    Spoilt("20 ppm", MOTOR, white, skew(20.0)),
    Spoilt("20 ppm, resonator", RESONATOR, multisine, skew(20.0), noise_db=60.0),
    Spoilt("50 ppm, chirp", COIL, chirp, skew(50.0)),
    Spoilt("200 ppm", COIL, white, skew(200.0)),
    Spoilt("200 ppm back", MOTOR, multisine, skew(-200.0), noise_db=40.0),
    Spoilt("500 ppm", RESONATOR, white, skew(500.0)),
    Spoilt("500 ppm, 30 s", COIL, white, skew(500.0), seconds=30.0, noise_db=60.0),
    Spoilt("gain falls 5 %", MOTOR, white, fall(0.05)),
    Spoilt("gain falls 10 %", COIL, multisine, fall(0.10)),
    Spoilt("gain falls 20 %", RESONATOR, white, fall(0.20), noise_db=40.0),
    Spoilt("gain falls 30 %, chirp", COIL, chirp, fall(0.30)),
    Spoilt("gain falls 30 %", MOTOR, white, fall(0.30)),
    Spoilt("amplifier tanh", MOTOR, white, none, amplifier=tanh(2.0)),
    Spoilt("amplifier tanh, hard", COIL, multisine, none, amplifier=tanh(1.0), noise_db=60.0),
    Spoilt("amplifier clips", COIL, white, none, amplifier=clip(1.5)),
    Spoilt("jitter 5 %", COIL, multisine, jitter(0.05, true=True), noise_db=60.0),
    Spoilt("jitter 30 %", MOTOR, white, jitter(0.30, true=True)),
    Spoilt("jitter 30 % of stamps alone", COIL, white, jitter(0.30, true=False)),
    Spoilt("jitter 5 % of stamps alone", RESONATOR, white, jitter(0.05, true=False)),
    Spoilt("backlash", MOTOR, white, backlash(0.10)),
    Spoilt("backlash, chirp", COIL, chirp, backlash(0.20)),
    Spoilt("dead zone", COIL, multisine, none, amplifier=dead(0.2)),
    Spoilt("columns swapped", MOTOR, white, swap),
    Spoilt("every 8th sample", COIL, multisine, decimate(8), seconds=40.0),
    Spoilt("every 4th sample, white", COIL, white, decimate(4)),
    Spoilt("every 3rd sample, white", RESONATOR, white, decimate(3)),
    Spoilt("cubic sensor", COIL, white, cubic(-0.05)),
)


@dataclass(frozen=True)
class Judged:
    """How a record came out: status, the largest error inside the valid range, in dB and beyond the band, the phase's
    beyond its band, degrees, and what was told."""

    status: int
    error_db: float
    beyond_db: float
    beyond_deg: float
    said: str

    @property
    def verdict(self) -> str:
        """Return ok, or WRONG: trusted and outside its band."""
        is_wrong = self.status == 0 and (self.beyond_db > MATERIAL_DB or self.beyond_deg > MATERIAL_DEG)
        return "WRONG" if is_wrong else "ok"


def judge(record: Spoilt, seed: int, folder: Path) -> Judged:
    """Return how `tactuator identify` answers the record as a CSV file."""
    taken = record.make(seed)
    path = folder / "record.csv"
    table = np.stack([taken.time_s, taken.command, taken.position], axis=1)
    np.savetxt(path, table, delimiter=",", header="time_s,command_v,position_v", comments="", fmt="%.9g")
    try:
        found = tt.identify(path)
    except BadInput as error:  # a refusal is an answer too
        return Judged(2, np.nan, np.nan, np.nan, str(error))
    assert isinstance(found, Identification)
    low, high = found.model.valid_hz or found.model.band_hz
    inside = np.geomspace(low, high, 300)

    def ratios(hertz: Array) -> NDArray[np.complex128]:
        own = np.outer(taken.gains, record.mechanism.response(hertz))
        return np.asarray(found.model.response(hertz) / own)

    off = np.abs(20.0 * np.log10(np.abs(ratios(inside)))).max(axis=0)
    turned = np.abs(np.degrees(np.angle(ratios(inside)))).max(axis=0) - np.degrees(found.model.band_rad(inside))
    said = "; ".join([*found.distrust, *found.remarks])
    beyond = float((off - found.model.band_db(inside)).max())
    return Judged(int(not found.holds), float(off.max()), beyond, float(turned.max()), said)


def main() -> int:
    """Print a line for each record; return 0 where none is wrong."""
    given = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    given.add_argument("--only", type=int, nargs="*", help="numbers of records")
    given.add_argument("--seed", type=int, default=1)
    given.add_argument("--width", type=int, default=60, help="letters of what was said")
    asked = given.parse_args()
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        for k, record in enumerate(RECORDS):
            if asked.only and k not in asked.only:
                continue
            begun = time.perf_counter()
            judged = judge(record, 1000 * asked.seed + k, Path(folder))
            bad += judged.verdict != "ok"
            took = time.perf_counter() - begun
            print(
                f"{k:2d} {record.name:32} {record.mechanism.name:9} status {judged.status} "
                f"error {judged.error_db:7.3f} dB, beyond its band {judged.beyond_db:7.3f}, phase beyond "
                f"{judged.beyond_deg:7.2f} {judged.verdict:5} {took:4.1f} s  "
                f"{judged.said[: asked.width]}",
                flush=True,
            )
    print(f"{bad} of {len(RECORDS)} wrong")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())

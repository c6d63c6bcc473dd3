"""Signals that excite a mechanism; every one has shape (n,) and a peak of at most 1 unless said. Tones begin and end
without a click.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.parameters import LONGEST_S
from tactuator.signals.systems import ContinuousSystem


def ramps(count: int, rate_hz: float, ramp_s: float) -> FloatArray:
    """Return a gain of shape (count,) that rises over `ramp_s` as (1 - cos)/2, stays 1, and falls the same way."""
    length = round(ramp_s * rate_hz)
    if ramp_s < 0.0 or 2 * length > count:
        raise BadInput(f"ramps of {ramp_s:g} s in {count / rate_hz:g} s", "zero or more, half the duration at most")
    gain = np.ones(count)
    if length:
        rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(length) + 0.5) / length)
        gain[:length] = rise
        gain[count - length :] = rise[::-1]
    return gain


@lru_cache(maxsize=8)
def raised_ends(count: int, length: int) -> NDArray[np.float32]:
    """Return `ramps` of `length` samples, float32; kept for the next time, and not to be written to."""
    gain = ramps(count, 1.0, length).astype(np.float32)
    gain.flags.writeable = False
    return gain


def tone(
    frequency_hz: float,
    amplitude: float,
    duration_s: float,
    rate_hz: float,
    *,
    ramp_s: float = 0.0,
) -> FloatArray:
    """Return the sinusoid amplitude * sin(2 pi f t), shape (n,), with ramps at both ends.

    Raises BadInput for a frequency outside 0 < f < rate/2, and as `sample_count` does.
    """
    if not 0.0 < frequency_hz < rate_hz / 2.0:
        raise BadInput(f"tone of {frequency_hz:g} Hz at {rate_hz:g} Hz", f"between 0 and {rate_hz / 2.0:g} Hz")
    count = sample_count(duration_s, rate_hz)
    time = np.arange(count) / rate_hz
    wave = amplitude * np.sin(2.0 * np.pi * frequency_hz * time)
    return wave * ramps(count, rate_hz, ramp_s)


def sample_count(duration_s: float, rate_hz: float) -> int:
    """Return the number of samples in `duration_s` at `rate_hz`. Raises BadInput for none, and for more than a day."""
    count = round(duration_s * rate_hz) if np.isfinite(duration_s) and np.isfinite(rate_hz) else 0
    if duration_s > LONGEST_S:
        raise BadInput(f"duration {duration_s:g} s", f"at most a day, {LONGEST_S:g} s")
    if count < 1:
        raise BadInput(f"duration {duration_s:g} s", f"at least one sample at {rate_hz:g} Hz")
    return count


def to_unit_peak(samples: FloatArray) -> FloatArray:
    """Return the same signal with a peak of 1; silence stays silent."""
    peak = float(np.max(np.abs(samples), initial=0.0))
    return samples / peak if peak > 0.0 else samples


def steps(duration_s: float, rate_hz: float, hold_s: float, rng: np.random.Generator) -> FloatArray:
    """Return random levels in -1 .. 1, each held for `hold_s`; neighbours differ by at least 0.3."""
    count, hold = sample_count(duration_s, rate_hz), sample_count(hold_s, rate_hz)
    levels = [0.0]
    while len(levels) * hold < count:
        level = float(rng.uniform(-1.0, 1.0))
        if abs(level - levels[-1]) >= 0.3:
            levels.append(level)
    return np.repeat(np.array(levels), hold)[:count]


def prbs(duration_s: float, rate_hz: float, clock_hz: float, rng: np.random.Generator) -> FloatArray:
    """Return a pseudo-random binary sequence of maximal length, +/-1, one bit for each 1/clock_hz, from a random start.

    Its spectrum is flat up to about 0.4 clock_hz. The register is the shortest whose period covers the duration.
    """
    count, bit = sample_count(duration_s, rate_hz), max(1, round(rate_hz / clock_hz))
    bits = int(np.clip(np.ceil(np.log2(count / bit + 2.0)), 4, 31))
    start = rng.integers(1, 2**bits)
    state = np.array([(int(start) >> k) & 1 for k in range(bits)], dtype=np.int8)
    sequence, _ = scipy.signal.max_len_seq(bits, state=state, length=-(-count // bit))
    return np.repeat(2.0 * sequence - 1.0, bit)[:count]


def noise(duration_s: float, rate_hz: float, band_hz: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """Return Gaussian noise confined to `band_hz`, clipped at four standard deviations, scaled to a peak of 1."""
    count = sample_count(duration_s, rate_hz)
    frequency = np.fft.rfftfreq(count, 1.0 / rate_hz)
    inside = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    if not np.any(inside):
        raise BadInput(f"no line of {duration_s:g} s lies within {band_hz[0]:g}..{band_hz[1]:g} Hz", "a longer record")
    spectrum = np.where(inside, rng.standard_normal(frequency.size) + 1j * rng.standard_normal(frequency.size), 0.0)
    samples = np.fft.irfft(spectrum, count)
    deviation = float(np.std(samples))
    return to_unit_peak(np.clip(samples, -4.0 * deviation, 4.0 * deviation))


def sinusoids(
    duration_s: float, rate_hz: float, frequency_hz: ArrayLike, amplitude: ArrayLike, rng: np.random.Generator
) -> FloatArray:
    """Sum of sinusoids with random phases; `frequency_hz` and `amplitude` have one shape (m,). Not rescaled."""
    time = np.arange(sample_count(duration_s, rate_hz)) / rate_hz
    frequency, amplitude = np.broadcast_arrays(np.atleast_1d(frequency_hz), np.atleast_1d(amplitude))
    total = np.zeros(time.size)
    for hertz, peak in zip(frequency.astype(float), amplitude.astype(float), strict=True):
        total += peak * np.sin(2.0 * np.pi * (hertz * time + rng.uniform()))
    return total


def log_chirp(duration_s: float, rate_hz: float, low_hz: float, high_hz: float) -> FloatArray:
    """Return a sinusoid whose frequency rises from low_hz to high_hz, the same time for each octave."""
    if not 0.0 < low_hz < high_hz <= rate_hz / 2.0:
        raise BadInput(f"chirp from {low_hz:g} to {high_hz:g} Hz at {rate_hz:g} Hz", "0 < low < high <= rate/2")
    time = np.arange(sample_count(duration_s, rate_hz)) / rate_hz
    growth = np.log(high_hz / low_hz) / duration_s
    swept: FloatArray = np.sin(2.0 * np.pi * low_hz * np.expm1(growth * time) / growth)
    return swept


def delimiter(rate_hz: float, hold_s: float = 0.05) -> FloatArray:
    """Return a pulse to one side, one to the other, and a rest as long as both, with a peak of 1. The paper (section 3)
    names a "delimiter" without saying what it is: it is taken for such a mark of where a record begins and ends.
    """
    return np.repeat([1.0, -1.0, 0.0, 0.0], sample_count(hold_s, rate_hz))


def paper_mix(
    duration_s: float,
    rate_hz: float,
    command_range_v: float,
    rng: np.random.Generator,
    *,
    plant: ContinuousSystem | None = None,
    travel_v: float | None = None,
    band_hz: tuple[float, float] = (0.4, 300.0),
    delimited: bool = False,
) -> FloatArray:
    """Return the paper's mix of steps, noise and sinusoids (section 3) as a command in volts, shape (n,), between two
    delimiters where `delimited`.

    A slow part (steps every 1.3 s and sinusoids in the lower band) and a fast part (noise over the whole band and
    sinusoids in the upper) are added. With a rough `plant` and `travel_v` (volts of y) each is planned to take 40 % of
    the travel and of 0.9 command_range_v at most; without them each takes 5 % and 40 % of command_range_v. A delimiter
    takes half as much as the slow part.
    """
    mark = delimiter(rate_hz) if delimited else np.zeros(0)
    duration_s -= 2.0 * mark.size / rate_hz
    low, high = band_hz[0], min(band_hz[1], 0.4 * rate_hz)
    middle = float(np.sqrt(low * high))
    slow = 0.6 * steps(duration_s, rate_hz, 1.3, rng)
    tones = np.geomspace(low, middle, 5)
    slow += 0.4 * to_unit_peak(sinusoids(duration_s, rate_hz, tones, 1.0, rng))
    fast = 0.6 * noise(duration_s, rate_hz, (low, 1.2 * high), rng)
    tones = np.geomspace(middle, high, 5)
    fast += 0.4 * to_unit_peak(sinusoids(duration_s, rate_hz, tones, tones / high, rng))
    parts = [slow, fast, mark]
    if plant is None or travel_v is None:
        factors = [0.05 * command_range_v, 0.4 * command_range_v, 0.025 * command_range_v]
        parts = [to_unit_peak(part) for part in parts]
    else:
        factors = [
            plan_amplitude(part, rate_hz, plant, share * travel_v, share * command_range_v) if part.size else 0.0
            for part, share in zip(parts, (0.4, 0.4, 0.2), strict=True)
        ]
    slow, fast, mark = (factor * part for factor, part in zip(factors, parts, strict=True))
    return np.concatenate([mark, slow + fast, mark])


def plan_amplitude(
    shape: ArrayLike, rate_hz: float, plant: ContinuousSystem, travel_v: float, command_range_v: float
) -> float:
    """Return the largest factor for the command `shape` (n,) with |command| <= command_range_v and, by `plant` (volts
    of y per volt), |y| <= travel_v, start-up transient included.
    """
    samples = np.asarray(shape, dtype=np.float64)
    if travel_v <= 0.0 or command_range_v <= 0.0 or not np.any(samples):
        raise BadInput(f"travel {travel_v:g} V, range {command_range_v:g} V", "both positive, and a shape that moves")
    position = periodic_response(np.append(samples, np.zeros(samples.size)), rate_hz, plant)
    reached = float(np.max(np.abs(position)))
    by_range = command_range_v / float(np.max(np.abs(samples)))
    return min(by_range, travel_v / reached) if reached > 0.0 else by_range


def known_part(
    shape: ArrayLike,
    rate_hz: float,
    plant: ContinuousSystem,
    order: int,
    band_hz: tuple[float, float],
    limits_v: tuple[float, float, float],
) -> FloatArray:
    """Return the part of a command, (n,), in the band that `plant` is known in, as large as its limits allow: of what
    travels, of what the sensor reads, and of the command.

    order: how often what the plant gives is the derivative of what travels, once or twice: beneath the band nothing is
    known of the travel, which may be any there. The command is as if repeated for ever.
    """
    spectrum = np.fft.rfft(np.asarray(shape, dtype=np.float64))
    frequency = np.fft.rfftfreq(np.size(shape), 1.0 / rate_hz)
    inside = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    if min(limits_v) <= 0.0 or not np.any(spectrum[inside]):
        limits = ", ".join(f"{limit:g}" for limit in limits_v)
        raise BadInput(f"limits of travel, reading and command of {limits} V", "all positive, and lines in the band")
    moved, read, kept = np.zeros((3, spectrum.size), dtype=np.complex128)
    place = frequency[inside]
    kept[inside] = spectrum[inside]
    read[inside] = spectrum[inside] * plant.response(place)
    moved[inside] = read[inside] / (2j * np.pi * place) ** order
    waves = [np.fft.irfft(lines, np.size(shape)) for lines in (moved, read, kept)]
    shares = [limit / max(float(np.max(np.abs(wave))), 1e-300) for limit, wave in zip(limits_v, waves, strict=True)]
    return np.asarray(min(shares) * waves[-1])


def periodic_response(command: FloatArray, rate_hz: float, plant: ContinuousSystem) -> FloatArray:
    """Return the steady answer of `plant` to a command (n,) repeated for ever; an integrator's mean is dropped."""
    spectrum = np.fft.rfft(command)
    frequency = np.fft.rfftfreq(command.size, 1.0 / rate_hz)
    response = np.zeros(frequency.size, dtype=np.complex128)
    response[1:] = plant.response(frequency[1:])
    if not np.any(plant.poles == 0.0):
        response[0] = plant.response(0.0)
    return np.asarray(np.fft.irfft(spectrum * response, command.size))

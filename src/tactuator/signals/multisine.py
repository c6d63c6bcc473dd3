"""Random-phase multisines: all lines at once, one period exactly, with a low crest factor.

Lines left out on purpose (detection lines) show nonlinear distortion: a linear mechanism answers with noise there. Even
distortion falls on even lines, odd distortion on the odd ones; noise differs between periods, and what differs between
realisations beyond it is distortion (Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2012,
chapter 4).

Frequencies that are played for those that are asked are within 2 %, inside the band, off mains, or refused: what the
sensor shows at a multiple of mains is not what the finger feels, so that a test frequency keeps 2 Hz away.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.signals.spectra import KEEP_OFF_HZ, nearest_mains, off_mains

Bins = NDArray[np.int64]
_KEYS = ("period_samples", "periods", "realisations", "excited_lines")
_ONE_SILENT_OF = 4
"""Of so many neighbouring lines one is left silent: distortion shows there."""
_MAINS_HZ = (50.0, 60.0)
"""Where it is not said which, lines keep off both."""


@dataclass(frozen=True)
class Multisine:
    """A sum of amplitude * cos(2 pi bin k / period + phase) over `period` samples at rate_hz.

    bins: excited lines, multiples of rate_hz/period, shape (m,).
    """

    rate_hz: float
    period: int
    bins: Bins
    amplitude: FloatArray
    phase_rad: FloatArray

    @property
    def frequency_hz(self) -> FloatArray:
        """Return the frequencies of the excited lines, hertz, shape (m,)."""
        return np.asarray(self.bins * self.rate_hz / self.period)

    def one_period(self) -> FloatArray:
        """Return one period of the signal, shape (period,)."""
        return _synthesise(self.period, self.bins, self.amplitude, self.phase_rad)

    def samples(self, periods: int) -> FloatArray:
        """Return `periods` periods in a row, shape (periods * period,)."""
        return np.tile(self.one_period(), periods)


def _synthesise(period: int, bins: Bins, amplitude: FloatArray, phase: FloatArray) -> FloatArray:
    spectrum = np.zeros(period // 2 + 1, dtype=np.complex128)
    spectrum[bins] = 0.5 * period * amplitude * np.exp(1j * phase)
    return np.asarray(np.fft.irfft(spectrum, period))


def place_lines(frequency_hz: ArrayLike, rate_hz: float, period: int, *, mains_hz: float | None = 60.0) -> Bins:
    """Return the odd lines of a period nearest to `frequency_hz` (m,), each used once, 2 Hz off mains.

    Odd lines alone leave every even line free to show even-order distortion. The lowest may be line 1. Raises BadInput
    where no free line is left below rate/2.
    """
    spacing = rate_hz / period
    odd = np.arange(1, period // 2, 2)
    if mains_hz:
        off = np.abs(odd * spacing - mains_hz * np.round(odd * spacing / mains_hz))
        near = (off < KEEP_OFF_HZ - 1e-9) & (odd * spacing > 0.5 * mains_hz)
        odd = odd[~near]
    chosen: list[int] = []
    for hertz in np.sort(np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))):
        free = odd[~np.isin(odd, chosen)]
        if free.size == 0 or not 0.0 < hertz < rate_hz / 2.0:
            raise BadInput(f"no free line for {hertz:g} Hz in a period of {period / rate_hz:g} s", "a longer period")
        chosen.append(int(free[np.argmin(np.abs(free * spacing - hertz))]))
    return np.array(sorted(chosen), dtype=np.int64)


def multisine(
    rate_hz: float,
    period: int,
    bins: ArrayLike,
    amplitude: ArrayLike,
    rng: np.random.Generator,
    *,
    rounds: int = 60,
) -> Multisine:
    """Return a multisine with random phases, improved by `rounds` of clipping (Van der Ouderaa et al., 1988).

    bins: lines, (m,); amplitude: peak of each, (m,) or one number.
    """
    lines = np.asarray(bins, dtype=np.int64)
    if lines.size == 0 or lines.min() < 1 or lines.max() >= period // 2 or np.unique(lines).size != lines.size:
        raise BadInput(f"lines {lines.tolist()} of a period of {period}", f"each once, 1 to {period // 2 - 1}")
    peaks = np.broadcast_to(np.asarray(amplitude, dtype=np.float64), lines.shape).copy()
    phase = rng.uniform(0.0, 2.0 * np.pi, lines.size)
    best, best_peak = phase, np.inf
    for _ in range(max(1, rounds)):
        wave = _synthesise(period, lines, peaks, phase)
        peak = float(np.max(np.abs(wave)))
        if peak < best_peak:
            best, best_peak = phase, peak
        clipped = np.clip(wave, -0.85 * peak, 0.85 * peak)
        phase = np.angle(np.fft.rfft(clipped)[lines])
    return Multisine(rate_hz, period, lines, peaks, best)


@dataclass(frozen=True, eq=False)
class Periods:
    """Realisations one after the other, each of `repeats` periods of `period` samples; the first of these settles.

    lines: the excited lines, multiples of rate/period, ascending, (m,).
    """

    period: int
    repeats: int
    realisations: int
    lines: Bins

    def __post_init__(self) -> None:
        if self.period < 8 or self.repeats < 2 or self.realisations < 1:
            raise BadInput(
                f"{self.realisations} realisations of {self.repeats} periods of {self.period} samples",
                "1 or more of 2 or more of 8 or more",
            )
        lines = self.lines
        if lines.size < 1 or lines[0] < 1 or lines[-1] >= self.period / 2 or np.any(np.diff(lines) <= 0):
            raise BadInput(f"excited lines of a period of {self.period} samples", "ascending, below half of it")

    @property
    def samples(self) -> int:
        """Return the number of samples of all realisations."""
        return self.realisations * self.repeats * self.period

    def blocks(self, values: FloatArray) -> FloatArray:
        """Return the settled periods of a record (n,): (realisations, repeats - 1, period)."""
        shape = (self.realisations, self.repeats, self.period)
        return np.asarray(values[: self.samples].reshape(shape)[:, 1:])

    def silent(self, rate_hz: float) -> tuple[Bins, Bins]:
        """Return the odd and the even lines within the excited band that are silent and not next to a multiple of the
        mains' frequency."""
        inside = np.setdiff1d(np.arange(int(self.lines[0]), int(self.lines[-1]) + 1), self.lines)
        spacing = rate_hz / self.period
        inside = inside[_off_mains_hz(np.asarray(inside * spacing, dtype=np.float64)) > 1.5 * spacing]
        return inside[inside % 2 == 1], inside[inside % 2 == 0]

    def attributes(self) -> dict[str, str]:
        """Return the plan as a record's file carries it."""
        values = (self.period, self.repeats, self.realisations, " ".join(str(k) for k in self.lines.tolist()))
        return dict(zip(_KEYS, (str(value) for value in values), strict=True))


def periods_of(about: Mapping[str, str], samples: int) -> Periods | None:
    """Return the plan that a record of that many samples carries among what is known of it, or None.

    Raises BadInput for a plan that cannot be read or does not fit the record.
    """
    if not all(key in about for key in _KEYS):
        return None
    try:
        period, repeats, realisations = (int(float(about[key])) for key in _KEYS[:3])
        lines = np.array([int(line) for line in about[_KEYS[3]].split()], dtype=np.int64)
    except ValueError:
        plan_as_read = ", ".join(f"{key} {about[key][:20]!r}" for key in _KEYS)
        raise BadInput(f"record: {plan_as_read}", "whole numbers") from None
    plan = Periods(period, repeats, realisations, lines)
    if plan.samples > samples:
        raise BadInput(f"record: {samples} samples, its periods need {plan.samples}", "as many or more")
    return plan


def without_periods(about: Mapping[str, str]) -> dict[str, str]:
    """Return what is known of a record without its plan, for a part of it."""
    return {key: value for key, value in about.items() if key not in _KEYS}


def odd_lines(band_hz: tuple[float, float], rate_hz: float, period: int, count: int, rng: np.random.Generator) -> Bins:
    """Return up to `count` odd lines of a period, even in log frequency over band_hz, without one of four at random.

    The lines next to a multiple of the mains' frequency are left out. Raises BadInput where fewer than eight are left.
    """
    spacing = rate_hz / period
    odd = np.arange(1, (period + 1) // 2, 2)
    hertz = np.asarray(odd * spacing, dtype=np.float64)
    inside = (hertz >= band_hz[0] * (1.0 - 1e-9)) & (hertz <= band_hz[1])
    odd = odd[inside & (_off_mains_hz(hertz) > 1.5 * spacing)]
    chosen: list[int] = []
    growth = (band_hz[1] / band_hz[0]) ** (1.0 / count)
    for line in odd.tolist():
        if not chosen or line >= growth * chosen[-1]:
            chosen.append(line)
    first = rng.integers(0, _ONE_SILENT_OF, len(chosen) // _ONE_SILENT_OF + 1)
    silent = {_ONE_SILENT_OF * k + int(place) for k, place in enumerate(first)}
    kept = [line for place, line in enumerate(chosen) if place not in silent]
    if len(kept) < 8:
        raise BadInput(
            f"a period of {period / rate_hz:.4g} s has {len(kept)} odd lines from {band_hz[0]:g} to {band_hz[1]:g} Hz",
            "8 or more (a longer record, fewer periods or realisations)",
        )
    return np.array(kept, dtype=np.int64)


def _off_mains_hz(frequency_hz: FloatArray) -> FloatArray:
    """Return how far frequencies (n,) lie from a multiple of either mains frequency."""
    off = [np.abs(frequency_hz - nearest_mains(frequency_hz, mains)) for mains in _MAINS_HZ]
    return np.asarray(np.minimum(*off))


Band = tuple[float, float]

TOLERANCE = 0.02
"""Greatest relative distance between a frequency that is asked and the one that is played for it."""


def over_the_band(band_hz: Band, mains_hz: float | None) -> FloatArray:
    """Return 30 frequencies over the band of our own choosing, hertz, moved off mains to the side inside the band."""
    # about ten a decade of the usual band
    return off_mains(np.geomspace(*band_hz, 30), mains_hz, band_hz=band_hz)


def tones(frequency_hz: ArrayLike, mains_hz: float | None, band_hz: Band) -> FloatArray:
    """Return the frequencies to play, ascending, each once, hertz: those asked, or the nearest 2 Hz off mains.

    Raises BadInput, naming the first, for a frequency outside band_hz, or one for which nothing within 2 % is inside
    the band and off mains.
    """
    asked = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    moved = off_mains(asked, mains_hz, band_hz=band_hz)
    for hertz, played in zip(asked.tolist(), moved.tolist(), strict=True):
        require_inside(hertz, band_hz)
        if abs(played - hertz) > TOLERANCE * hertz or not band_hz[0] <= played <= band_hz[1]:
            line = nearest_mains(hertz, mains_hz or hertz)
            raise BadInput(
                f"{hertz:g} Hz lies beside {line:g} Hz of mains, and nothing within 2 % of it is {KEEP_OFF_HZ:g} Hz "
                "off and inside the band",
                f"{line - KEEP_OFF_HZ:g} Hz or {line + KEEP_OFF_HZ:g} Hz, or no mains",
            )
    return np.unique(moved)


def require_inside(hertz: float, band_hz: Band) -> None:
    """Raise BadInput for a frequency outside the band."""
    if not band_hz[0] <= hertz <= band_hz[1]:
        raise BadInput(f"{hertz:g} Hz", f"{band_hz[0]:g} to {band_hz[1]:g} Hz, the band")


def multisine_lines(
    frequency_hz: ArrayLike,
    rate_hz: float,
    longest_s: float,
    mains_hz: float | None,
    band_hz: Band,
    exactly: bool = True,
) -> tuple[int, Bins]:
    """Return (period in samples, odd lines of it): the shortest period whose lines are all within 2 % of `frequency_hz`
    (m,), each line once, inside band_hz and off mains.

    Not `exactly`, for a sweep whose frequencies nobody asked for: the shortest period whose nearest lines all lie
    inside band_hz, or the longest that fits, with those of its lines that do. Raises BadInput, naming a frequency that
    cannot be played, where two periods of none fit into longest_s, or no line is inside the band.
    """
    asked = np.sort(np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64)))
    for hertz in asked if exactly else ():
        require_inside(float(hertz), band_hz)
    missed = f"two periods of {asked[0]:g} Hz within {longest_s:g} s"
    longest: tuple[int, Bins] | None = None
    # periods of the lowest line in the longest period that is tried
    for times in range(1, 201 + 1, 2):
        period = round(times * rate_hz / asked[0])
        if 2.0 * period / rate_hz > longest_s:
            break
        try:
            bins = place_lines(asked, rate_hz, period, mains_hz=mains_hz)
        except BadInput as error:  # more frequencies than such a period has lines
            missed = str(error) if exactly else missed
            continue
        played = bins * rate_hz / period
        inside = (played >= band_hz[0] * (1 - 1e-9)) & (played <= band_hz[1] * (1 + 1e-9))
        off = np.abs(played / asked - 1.0) if exactly else np.zeros(played.shape)
        bad = np.flatnonzero((off > TOLERANCE) | ~inside)
        if bad.size == 0:
            return period, bins
        if exactly:
            worst = int(bad[np.argmax(off[bad])])
            missed = f"{asked[worst]:g} Hz would be played as {played[worst]:g} Hz"
        elif np.any(inside):
            longest = (period, bins[inside])
    if longest is not None:
        return longest
    instead = ", frequencies further apart or off mains, or the stepped sine" if exactly else ""
    raise BadInput(missed, f"a longer time{instead}", where=("multisine",))

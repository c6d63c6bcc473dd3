"""Human detection thresholds against frequency, where they were felt, the curves that come with tactuator, and levels
as they are felt.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.resources import files
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tactuator.arrays import FloatArray, freeze_arrays, frequencies
from tactuator.errors import BadInput, within
from tactuator.parameters import Band, Number, Numbers, Positive, parameters, table, unit
from tactuator.result import FREQUENCY, Chart, ChartLine, Fact, Result, data, fields_of, found
from tactuator.signals.decibels import from_db


@table("contact")
class Contact:
    """What touches the skin, and where. None and "" say that nobody stated it.

    A threshold, and an equal-strength contour, hold for the contact they were measured at: a small contactor, one
    without a surround, another site or an older person feels another one.
    """

    site: Annotated[str, Field(description='where the skin is touched, as "index fingertip" or "thenar"')] = ""
    area_mm2: Annotated[Positive | None, Field(description="of the moving contactor")] = None
    surround: Annotated[str, Field(description='around the contactor, as "rigid, gap 1 mm" or "none"')] = ""
    preload_n: Annotated[Positive | None, Field(description="the force that presses skin and contactor together")] = (
        None
    )
    age_years: Annotated[Band | None, Field(description="of the people, youngest and oldest")] = None

    @property
    def said(self) -> dict[str, str]:
        """Return what is stated, by key, as a person reads it: with units."""
        stated = {key: getattr(self, key) for key in parameters(Contact) if getattr(self, key) not in (None, "")}
        return {key: _words(key, value) for key, value in stated.items()}

    def differences(self, other: Contact) -> Iterator[tuple[str, str, str]]:
        """Yield key, this one's words and the other's, where both state it and they differ.

        Sites are the same where one's words are among the other's: "fingertip" and "index fingertip". Areas and forces
        are within a factor of 1.5, ages where they overlap.
        """
        for key in self.said.keys() & other.said.keys():
            if not _alike(getattr(self, key), getattr(other, key)):
                yield key, self.said[key], other.said[key]


def _alike(mine: object, theirs: object) -> bool:
    if isinstance(mine, float) and isinstance(theirs, float):
        return 1.0 / 1.5 <= mine / theirs <= 1.5
    if isinstance(mine, tuple) and isinstance(theirs, tuple):
        return bool(mine[0] <= theirs[1] and theirs[0] <= mine[1])
    words = [set(str(each).lower().replace(",", " ").split()) for each in (mine, theirs)]
    return words[0] <= words[1] or words[1] <= words[0]


def _words(key: str, value: object) -> str:
    if isinstance(value, tuple):
        return f"{value[0]:g} to {value[1]:g} {unit(key)}"
    return f"{value:g} {unit(key)}" if isinstance(value, float) else str(value)


Provenance = Literal["measured", "digitised", "inferred", "synthetic", "simulated", "not stated"]


@table("threshold curve", eq=False)
class ThresholdCurve(Result):
    """Detection threshold: level of a sinusoid's peak displacement, dB re 1 um, at ascending frequencies.

    frequency_hz, level_db_re_1um: shape (n,), n >= 3. Between the points the level is linear in log frequency; beyond
    them it is held constant, so that DC has a meaning. standard_error_db: shape (n,), where the curve was measured.
    provenance: how the numbers came about; source: one line for a figure's caption. contact: where it was felt.
    bound: of each point, ">=" or "<=" where the threshold is known from that side alone, "" where it was measured; None
    where no point is a bound.

    Raises BadInput for fewer than three points, frequencies that are not positive and strictly ascending, or numbers
    that are not finite.
    """

    name: str
    frequency_hz: Numbers
    level_db_re_1um: Numbers
    provenance: Provenance = "not stated"
    source: str = ""
    standard_error_db: Numbers | None = None
    contact: Contact = field(default_factory=Contact)
    bound: tuple[Literal["", ">=", "<="], ...] | None = None

    __repr__ = Result.__repr__

    def __post_init__(self) -> None:
        freeze_arrays(self, "frequency_hz", "level_db_re_1um", "standard_error_db")
        with within(repr(self.name)):
            self._check()

    def facts(self) -> Sequence[Fact]:
        """Return name, provenance, band and number of points, and the fields."""
        return [
            found("name", self.name),
            found("provenance", self.provenance),
            found("band", f"{self.frequency_hz[0]:g} to {self.frequency_hz[-1]:g} Hz"),
            found("points", self.frequency_hz.size),
            *data(fields_of(self)),
        ]

    def columns(self) -> Mapping[str, Any]:
        """Return frequency and level of the points."""
        return {"frequency_hz": self.frequency_hz, "level_db_re_1um": self.level_db_re_1um}

    def chart(self) -> Chart:
        """Return the curve, and the levels that are comfortable above it."""
        return threshold_chart({f"{self.name} ({self.provenance})": self}, COMFORT_DB_SL)

    def _check(self) -> None:
        frequency, level = self.frequency_hz, self.level_db_re_1um
        if frequency.ndim != 1 or frequency.shape != level.shape:
            raise BadInput(f"{frequency.size} frequencies and {level.size} levels", "as many of each")
        if frequency.size < POINTS_MIN:
            raise BadInput(f"{frequency.size} points", "three or more")
        if not (np.all(np.isfinite(frequency)) and np.all(np.isfinite(level))):
            raise BadInput("a frequency or level is not a finite number")
        if np.any(frequency <= 0.0):
            raise BadInput(f"frequency {frequency.min():g} Hz", "positive")
        steps = np.diff(frequency)
        if np.any(steps == 0.0):
            raise BadInput(f"{frequency[1:][steps == 0.0][0]:g} Hz occurs twice", "each frequency once")
        if np.any(steps < 0.0):
            raise BadInput(f"{frequency[1:][steps < 0.0][0]:g} Hz is out of order", "ascending frequencies")
        errors = self.standard_error_db
        if errors is not None and errors.shape != frequency.shape:
            raise BadInput(f"{errors.size} standard errors for {frequency.size} points", "one each")
        if self.bound is not None and len(self.bound) != frequency.size:
            raise BadInput(f"{len(self.bound)} bounds for {frequency.size} points", "one each")

    @property
    def bounds_said(self) -> str:
        """Return which points are bounds, as a person reads it; "" for none."""
        points = [
            f"{sign} at {hertz:g}" for hertz, sign in zip(self.frequency_hz, self.bound or (), strict=False) if sign
        ]
        return f"known from one side alone, {', '.join(points)} Hz" if points else ""

    def require_measured(self) -> None:
        """Raise BadInput for a curve of bounds alone: nobody's threshold is known at any of its points."""
        if self.bound is not None and all(self.bound):
            raise BadInput(f"threshold curve {self.name}: no point is measured, all are bounds", "one measured or more")

    def level_db_re_1um_at(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return the threshold level (dB re 1 um peak) at `frequency_hz` (any shape, zero allowed)."""
        frequency = np.clip(frequencies(frequency_hz), *self.frequency_hz[[0, -1]])
        return np.asarray(np.interp(np.log(frequency), np.log(self.frequency_hz), self.level_db_re_1um))

    def displacement_mm(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return the peak displacement at threshold, millimetres."""
        return from_db(self.level_db_re_1um_at(frequency_hz)) * 1e-3

    def covers(self, low_hz: float, high_hz: float) -> bool:
        """Return whether the points reach over the whole band."""
        return bool(self.frequency_hz[0] <= low_hz and high_hz <= self.frequency_hz[-1])

    @cached_property
    def content_hash(self) -> str:
        """Return SHA-256 (hex) of the points as little-endian doubles: the same curve has the same hash anywhere."""
        digest = hashlib.sha256()
        digest.update(self.frequency_hz.astype("<f8").tobytes())
        digest.update(self.level_db_re_1um.astype("<f8").tobytes())
        return digest.hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ThresholdCurve) and (self.name, self.content_hash) == (other.name, other.content_hash)

    def __hash__(self) -> int:
        return hash((self.name, self.content_hash))


POINTS_MIN = 3
"""Number of points that a curve has at least."""
AMPLITUDE_JND_DB = 1.65
"""Smallest just-noticeable difference of amplitude at an index fingerpad on this kind of display, dB: the least of the
1.65 to 2.98 dB of Israr, Tan and Reed (2006), JASA 120:2789."""
FREQUENCY_JND = 0.13
"""Smallest just-noticeable difference of frequency there, as a share of it: the least of 0.13 to 0.38 (the same)."""
COMFORT_DB_SL = 55.0
"""The greatest comfortable level: 50-55 dB above threshold (Verrillo & Gescheider 1992, the paper's reference 7)."""
FELT_BAND_HZ = (2.0, 300.0)
"""Where levels are felt and compared, hertz: from the paper's lowest frequency to the end of its band."""
LOWEST_DB_SL = -60.0
"""The least level that may be asked for: far below what is felt and what a sensor resolves. Below some
-6500 dB SL an amplitude is zero in double precision, and a ratio to it is no number."""
Level = Annotated[Number, Field(ge=LOWEST_DB_SL, le=COMFORT_DB_SL)]
"""A level in dB SL that the display may be asked for."""


def check_level(level_db_sl: float) -> None:
    """Raise BadInput for a level that is not from LOWEST_DB_SL to COMFORT_DB_SL."""
    if not LOWEST_DB_SL <= level_db_sl <= COMFORT_DB_SL:
        most = f"{COMFORT_DB_SL:g} dB SL, which is still comfortable"
        raise BadInput(f"{level_db_sl:g} dB SL", f"{LOWEST_DB_SL:g} to {most}", key="level_db_sl")


_SHIPPED: dict[str, tuple[str, Provenance, str, Contact]] = {
    "bolanowski-1988": (
        "digitised-bolanowski-1988-thenar.csv",
        "inferred",
        "Bolanowski et al. (1988), thenar eminence; recovered from a table of accelerations, attribution inferred",
        Contact("thenar", 290.0, "rigid"),
    ),
    "morioka-griffin-2006": (
        "morioka-griffin-2006-handle.csv",
        "digitised",
        "Morioka & Griffin (2006), hand-transmitted vibration on a handle; published accelerations converted",
        Contact("hand on a handle"),
    ),
}


def curve_names() -> tuple[str, ...]:
    """Return the names that `curve` knows."""
    return tuple(_SHIPPED)


@cache
def curve(name: str) -> ThresholdCurve:
    """Return the curve of that name. Raises BadInput, with the names that there are, for another."""
    if name not in _SHIPPED:
        raise BadInput(f"threshold curve {name!r} is not in the library", f"{', '.join(_SHIPPED)}")
    filename, provenance, source, contact = _SHIPPED[name]
    text = files("tactuator.perception").joinpath("data", filename).read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows[1:]])
    frequency, values = table[:, 0], table[:, 1]
    if rows[0].split(",")[1] == "acceleration_m_s2_rms":
        values = level_from_acceleration(frequency, values)
    return ThresholdCurve(name, frequency, values, provenance, source, contact=contact)


def level_from_acceleration(
    frequency_hz: np.ndarray[tuple[int], np.dtype[np.float64]],
    acceleration_m_s2_rms: np.ndarray[tuple[int], np.dtype[np.float64]],
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the level of a sinusoid of that rms acceleration: 20 log10(sqrt(2) a / (2 pi f)^2 / 1e-6)."""
    peak_m = np.sqrt(2.0) * acceleration_m_s2_rms / (2.0 * np.pi * frequency_hz) ** 2
    return np.asarray(20.0 * np.log10(peak_m / 1e-6))


_MOST_DB = 200.0
"""No person's level is further from 0 dB SL."""


@dataclass(frozen=True, eq=False)
class RelativeCurve:
    """Level level_db_sl at ascending frequency_hz, shape (n,), n >= 1: linear in log frequency between, held beyond.

    Two points with the same level are a flat loss; one is enough for that. Raises BadInput for frequencies that are not
    positive and strictly ascending, numbers that are not finite, or levels beyond 200 dB.
    """

    frequency_hz: NDArray[np.float64]
    level_db_sl: NDArray[np.float64]
    name: str = "truth"

    def __post_init__(self) -> None:
        frequency, level = self.frequency_hz, self.level_db_sl
        if frequency.ndim != 1 or frequency.shape != level.shape or frequency.size < 1:
            raise BadInput(f"curve {self.name!r}: {frequency.size} frequencies, {level.size} levels", "as many")
        if not (np.all(np.isfinite(frequency)) and np.all(np.abs(level) <= _MOST_DB)):
            got = f"curve {self.name!r}: a number is not finite, or a level beyond {_MOST_DB:g} dB"
            raise BadInput(got, "frequencies in Hz and levels in dB SL")
        if frequency[0] <= 0.0 or np.any(np.diff(frequency) <= 0.0):
            raise BadInput(f"curve {self.name!r}: frequencies are not in order", "positive, strictly ascending")

    def level_db_sl_at(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """Return the level in dB SL at `frequency_hz`, of any shape."""
        asked = np.log(frequencies(frequency_hz))
        return np.asarray(np.interp(asked, np.log(self.frequency_hz), self.level_db_sl))


def threshold_chart(curves: Mapping[str, ThresholdCurve], comfort_db_sl: float) -> Chart:
    """Return the chart of threshold curves by label, each with the level that is comfortable above it."""
    drawn = []
    for number, (label, curve) in enumerate(curves.items()):
        hertz, level, error = curve.frequency_hz, curve.level_db_re_1um, curve.standard_error_db
        named = label if error is None else f"{label}, ± its standard error"
        words = f"comfort, {comfort_db_sl:g} dB above it" if number == 0 else ""
        drawn.append(ChartLine(named, hertz, level, "o-", error, colour=number))
        drawn.append(ChartLine(words, hertz, level + comfort_db_sl, "--", colour=number))
    return Chart(FREQUENCY, "level (dB re 1 µm, peak)", drawn, log_x=True)

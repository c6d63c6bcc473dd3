"""Android 16: envelopes of vibration as XML, and what its system makes of them on a device.

The XML is that of the platform's own parser (`SerializedBasicEnvelopeEffect`, `SerializedWaveformEnvelopeEffect`); what
every device has to play is told by `VibratorEnvelopeEffectInfo`. What an intensity becomes on a device is computed as
`BasicToPwleSegmentAdapter` does (all Android Open Source Project, Apache-2.0, read and not copied).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, within
from tactuator.io.text import read_text, table_rows
from tactuator.parameters import Numbers, table
from tactuator.patterns.clip import LONGEST_S, MOST_POINTS, Breakpoints, Clip, Format, Tone, number_of, whole_of
from tactuator.signals.decibels import db, from_db
from tactuator.table import brief

SURE_POINTS, SURE_STEP_MS = 16, (20, 1000)
"""What every device with envelope effects plays: so many control points, each reached in so many milliseconds."""
LEAST_DB_SL = 10.0
"""Sharpness is spread over the frequencies at which a device reaches this level."""
_THRESHOLD = np.array(
    [
        (0.4, -97.81), (2.0, -69.86), (3.0, -62.81), (4.0, -58.81), (5.0, -56.69), (6.0, -54.77), (7.2, -52.85),
        (8.0, -51.77), (8.64, -50.84), (10.0, -48.90), (10.37, -48.52), (12.44, -46.50), (14.93, -44.43),
        (15.0, -44.35), (17.92, -41.96), (20.0, -40.36), (21.5, -39.60), (25.0, -37.48), (25.8, -36.93),
        (30.0, -34.31), (35.0, -33.13), (40.0, -32.81), (50.0, -31.94), (60.0, -31.77), (70.0, -31.59),
        (72.0, -31.55), (80.0, -31.77), (86.4, -31.94), (90.0, -31.73), (100.0, -31.90), (103.68, -31.77),
        (124.42, -31.70), (149.3, -31.38), (150.0, -31.35), (179.16, -31.02), (200.0, -30.86), (215.0, -30.35),
        (250.0, -28.98), (258.0, -28.68), (300.0, -26.81), (400.0, -19.81),
    ]
)  # fmt: skip
"""The platform's least perceptible acceleration: hertz, dB re 1 g; the curve bolanowski-1988 within 0.02 dB."""


@table("Android frequency profile", eq=False)
class FrequencyProfile:
    """The greatest acceleration (g) that a device reaches at ascending frequencies (Hz), shape (n,), n >= 2; straight
    between them, held beyond. Raises BadInput for frequencies out of order, or accelerations that are not positive.
    """

    frequency_hz: Numbers
    acceleration_g: Numbers

    __repr__ = brief

    def __post_init__(self) -> None:
        frequency, acceleration = self.frequency_hz, self.acceleration_g
        if frequency.ndim != 1 or frequency.shape != acceleration.shape or frequency.size < 2:
            raise BadInput(f"{frequency.size} frequencies and {acceleration.size} accelerations", "two or more of each")
        if not (frequency[0] > 0.0 and np.all(np.diff(frequency) > 0.0) and np.isfinite(frequency[-1])):
            raise BadInput("frequencies that are not in order", "positive, ascending")
        if not np.all((acceleration > 0.0) & np.isfinite(acceleration)):
            raise BadInput(f"an acceleration of {acceleration.min():g} g", "above 0")

    def greatest_g(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return the greatest acceleration (g) at frequencies of any shape."""
        return np.asarray(np.interp(np.asarray(frequency_hz, float), self.frequency_hz, self.acceleration_g))

    def headroom_db_sl(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return the greatest level (dB SL) at frequencies of any shape."""
        return db(self.greatest_g(frequency_hz)) - threshold_db_g(frequency_hz)

    @property
    def band_hz(self) -> tuple[float, float]:
        """Return the frequencies of sharpness 0 and 1: from where 10 dB SL are reached first to where they are not any
        more. Raises BadInput for a device that reaches them nowhere.
        """
        hertz, gs = self.frequency_hz, self.acceleration_g
        needed = from_db(LEAST_DB_SL + threshold_db_g(hertz))
        reached = np.flatnonzero(gs >= needed)
        if reached.size == 0:
            raise BadInput(f"{self.headroom_db_sl(hertz).max():.1f} dB SL at most", f"{LEAST_DB_SL:g} dB SL somewhere")
        first = int(reached[0])
        lost = np.flatnonzero(gs[first + 1 :] <= needed[first + 1 :]) + first + 1
        low = float(hertz[0]) if first == 0 else self._crossing(first - 1, needed[first])
        return low, self._crossing(int(lost[0]) - 1, needed[lost[0]]) if lost.size else float(hertz[-1])

    def _crossing(self, before: int, needed_g: float) -> float:
        """Return where the straight line from a point to the next has the acceleration that the next one needs."""
        (a, b), (f, g) = self.acceleration_g[before : before + 2], self.frequency_hz[before : before + 2]
        return float(f + (g - f) * np.clip((needed_g - a) / (b - a), 0.0, 1.0)) if a != b else float(f)

    @property
    def full_db_sl(self) -> float:
        """Return the level of intensity 1: that of the greatest acceleration within the band."""
        low, high = self.band_hz
        inside = np.flatnonzero((self.frequency_hz >= low) & (self.frequency_hz <= high))
        loudest = inside[np.argmax(self.acceleration_g[inside])]
        return float(self.headroom_db_sl(self.frequency_hz[loudest]))

    def amplitude(self, intensity: ArrayLike, frequency_hz: ArrayLike) -> FloatArray:
        """Return the amplitude (0 to 1, a share of the greatest acceleration) that intensities become; 0 is off.

        accel_g = 10^((I SLmax + thr(f))/20), amplitude = min(1, accel_g / greatest_g(f)); arguments broadcast.
        """
        asked = np.asarray(intensity, dtype=np.float64)
        wanted = from_db(asked * self.full_db_sl + threshold_db_g(frequency_hz))
        return np.where(asked > 0.0, np.minimum(1.0, wanted / self.greatest_g(frequency_hz)), 0.0)


def threshold_db_g(frequency_hz: ArrayLike) -> FloatArray:
    """Return the platform's threshold, dB re 1 g, at frequencies of any shape: straight in hertz, held beyond."""
    return np.asarray(np.interp(np.asarray(frequency_hz, dtype=np.float64), *_THRESHOLD.T))


_COLUMNS = ("frequency_hz", "acceleration_g")


def read_profile(path: str | Path) -> FrequencyProfile:
    """Return the frequency profile in a CSV of frequency_hz and acceleration_g, in any order of frequencies. Raises
    BadInput for a file that is none, within it.
    """
    with within(str(path)):
        rows = table_rows([line for line in read_text(Path(path)).split("\n") if not line.startswith("#")])
        if not rows or sorted(rows[0]) != sorted(_COLUMNS) or any(len(row) != 2 for row in rows):
            raise BadInput(f"columns {', '.join(rows[0])[:60] if rows else 'nothing'}", " and ".join(_COLUMNS))
        try:
            cells = np.array([[float(cell) for cell in row] for row in rows[1:]]).reshape(-1, 2)
        except ValueError:
            raise BadInput("a cell that is no number", "numbers") from None
        frequency, acceleration = (cells[:, rows[0].index(name)] for name in _COLUMNS)
        order = np.argsort(frequency, kind="stable")
        return FrequencyProfile(frequency[order], acceleration[order])


def profile_text(profile: FrequencyProfile, head: Sequence[str] = ()) -> str:
    """Return a frequency profile as the text of a CSV, after the lines of its head."""
    rows = zip(profile.frequency_hz, profile.acceleration_g, strict=True)
    lines = [*(f"# {line}" for line in head), ",".join(_COLUMNS), *(f"{hertz:.6g},{g:.6g}" for hertz, g in rows)]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class _Kind:
    """A kind of envelope: format, names of its attributes, and the pitches that it allows."""

    format: Format
    initial: str
    strength: str
    pitch: str
    least: float
    most: float


_KINDS: Mapping[str, _Kind] = {
    "basic-envelope-effect": _Kind("android-basic", "initialSharpness", "intensity", "sharpness", 0.0, 1.0),
    "waveform-envelope-effect": _Kind(
        "android-advanced", "initialFrequencyHz", "amplitude", "frequencyHz", math.ulp(0.0), 20_000.0
    ),
}


def parse_vibration_effect(text: str) -> Clip:
    """Return the clip of an envelope effect. It begins at zero strength, and each control point is reached in its
    duration; a basic one has to end at zero. What not every device plays is told. Raises BadInput, with the reason
    alone, for what breaks a rule.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise BadInput("a document type or entity", "a vibration-effect without one")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError):
        raise BadInput("it is not XML") from None
    if root.tag != "vibration-effect" or root.attrib or len(root) != 1 or root[0].tag not in _KINDS:
        allowed = f"vibration-effect with one of {', '.join(_KINDS)}"
        raise BadInput(f"<{root.tag[:40]}> with {len(root)} parts", allowed)
    effect, kind = root[0], _KINDS[root[0].tag]
    points = list(effect)
    if not points or len(points) > MOST_POINTS or any(point.tag != "control-point" or len(point) for point in points):
        raise BadInput(f"{len(points)} parts", f"1 to {MOST_POINTS} control points", where=(effect.tag,))
    if any((part.text or "").strip() or (part.tail or "").strip() for part in (root, effect, *points)):
        raise BadInput("text between its tags", "tags alone", where=(effect.tag,))
    times, strengths, pitches = [0.0], [0.0], []
    for k, point in enumerate(points):
        where = f"{effect.tag}[{k}]"
        row = _attributes(point, (kind.strength, kind.pitch, "durationMs"), where)
        times.append(times[-1] + 1e-3 * whole_of(row, "durationMs", 1, round(1e3 * LONGEST_S), where))
        strengths.append(number_of(row, kind.strength, 0.0, 1.0, where))
        pitches.append(number_of(row, kind.pitch, kind.least, kind.most, where))
    first = _attributes(effect, (kind.initial,), effect.tag)
    begins = number_of(first, kind.initial, kind.least, kind.most, effect.tag, missing=pitches[0])
    if kind.format == "android-basic" and strengths[-1] != 0.0:
        raise BadInput(f"{strengths[-1]:g}", "0 at the end", where=(effect.tag,), key=kind.strength)
    at = np.array(times)
    tone = Tone(0.0, times[-1], Breakpoints(at, np.array(strengths)), Breakpoints(at, np.array([begins, *pitches])))
    in_hz, unsure = kind.format == "android-advanced", _unsure(at, strengths)
    return Clip("", kind.format, times[-1], (tone,), (), pitch_in_hz=in_hz, unsure=unsure)


def _unsure(times: FloatArray, strengths: Sequence[float]) -> tuple[str, ...]:
    steps, (least, most) = np.round(1e3 * np.diff(times)), SURE_STEP_MS
    findings = {
        f"{steps.size} control points; sure: {SURE_POINTS}": steps.size > SURE_POINTS,
        f"a step of {steps.min():g} ms; sure: {least} ms or more": bool(steps.min() < least),
        f"a step of {steps.max():g} ms; sure: {most} ms or less": bool(steps.max() > most),
        f"an end at {strengths[-1]:g}; sure: an end at 0": strengths[-1] != 0.0,
    }
    return tuple(words for words, holds in findings.items() if holds)


def _attributes(part: ElementTree.Element, keys: Sequence[str], where: str) -> dict[str, float]:
    """Return the attributes of a tag as numbers. Raises BadInput for another attribute, or another text."""
    values = {}
    for key, text in part.attrib.items():
        if key not in keys:
            raise BadInput("not a key that is known", ", ".join(keys), where=(where,), key=key[:40])
        try:
            values[key] = float(text)
        except ValueError:
            values[key] = math.nan
        if not math.isfinite(values[key]) or "_" in text:
            raise BadInput(repr(text)[:60], "a number", where=(where,), key=key)
    return values

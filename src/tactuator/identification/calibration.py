"""Sensor calibration: pairs of displacement and voltage become a gain with its confidence."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactuator.errors import BadInput
from tactuator.model.plausibility import pairs_doubts
from tactuator.plain import picked
from tactuator.result import Chart, ChartLine, Fact, Result, data, found

_LARGEST, _SMALLEST = 1e9, 1e-12
"""Largest number (mm, V) and smallest range: far beyond any sensor, and their squares are still numbers."""
_OUTLIER_PROBABILITY = 0.002
"""Chance, over all pairs together, of refusing one when none is wrong."""


@dataclass(frozen=True)
class RefusedPair:
    """A pair that does not belong to the line of the others."""

    name: str
    displacement_mm: float
    voltage_v: float
    off_line_v: float

    def __str__(self) -> str:
        return f"{self.name} ({self.displacement_mm:g} mm, {self.voltage_v:g} V) lies {self.off_line_v:+.3g} V off"


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Result):
    """The line voltage = gain * displacement + offset, with 95 % half-widths. It draws both.

    linearity_percent: largest departure of a kept pair from the line, in percent of the voltage span.
    displacement_mm, voltage_v, residual_v: the kept pairs, shape (n,).
    """

    gain_v_per_mm: float
    gain_confidence_v_per_mm: float
    offset_v: float
    offset_confidence_v: float
    linearity_percent: float
    displacement_mm: NDArray[np.float64]
    voltage_v: NDArray[np.float64]
    residual_v: NDArray[np.float64]
    refused: tuple[RefusedPair, ...]

    def notices(self) -> Sequence[str]:
        """Return the pairs that were refused, and doubts about their units."""
        doubts = pairs_doubts(self.displacement_mm, self.voltage_v)
        return [*(f"refused: {pair}" for pair in self.refused), *(f"note: {doubt}" for doubt in doubts)]

    def facts(self) -> Sequence[Fact]:
        """Return gain and offset with their confidence, and the pairs that were refused."""
        gain, gain_half = self.gain_v_per_mm, self.gain_confidence_v_per_mm
        spans = {"displacements": (self.displacement_mm, "mm"), "voltages": (self.voltage_v, "V")}
        return [
            found("gain", f"{gain:.5g} ± {gain_half:.2g} V/mm"),
            found("offset", f"{self.offset_v:.4g} ± {self.offset_confidence_v:.2g} V"),
            found("refused", ", ".join(pair.name for pair in self.refused) or "none"),
            Fact("sensor_gain_v_per_mm", gain),
            Fact("sensor_gain_confidence_v_per_mm", gain_half),
            *data(picked(self, "offset_v", "offset_confidence_v")),
            Fact("linearity_percent", self.linearity_percent, "largest departure from the line, of span", "%", ".2f"),
            Fact("pairs", self.displacement_mm.size, "pairs"),
            Fact("refused", [vars(pair) for pair in self.refused]),
            *(Fact("", f"{min(of):.4g} to {max(of):.4g}", name, unit) for name, (of, unit) in spans.items()),
        ]

    def next_step(self) -> str:
        """Return the line for the display file."""
        return f"sensor_gain_v_per_mm = {self.gain_v_per_mm:.5g} in the display file"

    def columns(self) -> Mapping[str, Any]:
        """Return the pairs, and how far each lies off the line."""
        return picked(self, "displacement_mm", "voltage_v", "residual_v")

    def chart(self) -> Chart:
        """Return the pairs and their line."""
        x = np.concatenate([self.displacement_mm, [pair.displacement_mm for pair in self.refused]])
        y = np.concatenate([self.voltage_v, [pair.voltage_v for pair in self.refused]])
        ends = np.array([x.min(), x.max()])
        words = f"({self.gain_v_per_mm:.5g} ± {self.gain_confidence_v_per_mm:.2g}) V/mm, 95 %"
        crossed = np.arange(x.size) >= self.displacement_mm.size
        pairs = ChartLine("pairs (crossed: refused)" if self.refused else "pairs", x, y, "o", crossed=crossed)
        line = ChartLine(words, ends, self.gain_v_per_mm * ends + self.offset_v)
        return Chart("displacement (mm)", "sensor (V)", [pairs, line])


def fit_line(
    displacement_mm: ArrayLike, voltage_v: ArrayLike, *, gauge_error_mm: float = 0.0, names: list[str] | None = None
) -> Calibration:
    """Return the least-squares line through pairs of dial-gauge displacement (mm) and sensor voltage (V), both of shape
    (n,).

    gauge_error_mm is the gauge's own standard error: it pulls a least-squares slope towards zero, and the slope is
    corrected for that (Fuller, Measurement Error Models, 1987, section 1.2). Pairs whose studentised residual is
    beyond the Bonferroni bound are left out of the fit and named in `refused`. They scatter by their rounding at least:
    readings of two decimals may all lie on one line that is not the sensor's. Raises BadInput for fewer than 4 pairs,
    values that are not finite, displacements that do not vary, or where more than a quarter would be refused.
    """
    x, y = np.asarray(displacement_mm, dtype=np.float64), np.asarray(voltage_v, dtype=np.float64)
    labels = names if names is not None else [f"pair {k + 1}" for k in range(x.size)]
    _check_pairs(x, y, labels)
    rounding_v = _rounding(y)
    kept = _kept_pairs(x, y, rounding_v)
    if kept.sum() < max(4, 0.75 * x.size):
        bad = ", ".join(label for label, keep in zip(labels, kept, strict=True) if not keep)
        raise BadInput(f"{x.size - kept.sum()} of {x.size} pairs are off the line ({bad})", "a quarter at most")
    return _line(x, y, kept, gauge_error_mm, labels, rounding_v)


def _rounding(values: NDArray[np.float64]) -> float:
    """Return the rms of the rounding of values that all have the same few decimals, or 0.0."""
    # voltages are taken for rounded that have fewer decimals, all of them
    for step in 10.0 ** -np.arange(7):
        if np.all(np.abs(values / step - np.round(values / step)) < 1e-6):
            return float(step / np.sqrt(12.0))
    return 0.0


def _check_pairs(x: NDArray[np.float64], y: NDArray[np.float64], labels: list[str]) -> None:
    if x.ndim != 1 or x.shape != y.shape or len(labels) != x.size:
        raise BadInput(f"{x.size} displacements, {y.size} voltages, {len(labels)} names", "as many of each")
    if x.size < 4:
        raise BadInput(f"{x.size} pairs", "4 or more")
    for label, xk, yk in zip(labels, x, y, strict=True):
        if not (abs(xk) <= _LARGEST and abs(yk) <= _LARGEST):
            raise BadInput(f"{label} is ({xk:g} mm, {yk:g} V)", f"finite numbers up to {_LARGEST:g}")
    if np.ptp(x) <= _SMALLEST or np.ptp(y) <= _SMALLEST:
        what = "displacement" if np.ptp(x) <= _SMALLEST else "voltage"
        raise BadInput(f"every {what} is the same", "pairs that span a range")


def _kept_pairs(x: NDArray[np.float64], y: NDArray[np.float64], rounding_v: float) -> NDArray[np.bool_]:
    """Start from the half of the pairs nearest to the median line, then let in all that belong to it."""
    slope = scipy.stats.theilslopes(y, x)[0]
    distance = np.abs(y - slope * x - np.median(y - slope * x))
    kept: NDArray[np.bool_] = distance <= np.median(distance)
    for _ in range(20):
        offset, gain, scatter = _fit(x[kept], y[kept], rounding_v)
        residual = np.abs(y - offset - gain * x)
        centred = x - x[kept].mean()
        leverage = 1.0 / kept.sum() + centred**2 / np.sum(centred[kept] ** 2)
        if kept.sum() < x.size:
            scatter = max(scatter, float(1.4826 * np.median(residual)))
        spread = scatter * np.sqrt(np.where(kept, np.maximum(1.0 - leverage, 0.05), 1.0 + leverage))
        bound = scipy.stats.t.isf(_OUTLIER_PROBABILITY / (2.0 * x.size), max(kept.sum() - 2, 1))
        now = residual <= bound * spread + 1e-12 * np.ptp(y)
        if np.array_equal(now, kept):
            break
        kept = now
    return kept


def _fit(x: NDArray[np.float64], y: NDArray[np.float64], rounding_v: float) -> tuple[float, float, float]:
    centre = x.mean()
    gain = float(np.sum((x - centre) * (y - y.mean())) / np.sum((x - centre) ** 2))
    offset = float(y.mean() - gain * centre)
    scatter = np.sqrt(np.sum((y - offset - gain * x) ** 2) / max(x.size - 2, 1))
    return offset, gain, max(float(scatter), rounding_v)


def _line(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    kept: NDArray[np.bool_],
    gauge_error_mm: float,
    labels: list[str],
    rounding_v: float,
) -> Calibration:
    offset, gain, scatter = _fit(x[kept], y[kept], rounding_v)
    count = int(kept.sum()) - 2
    centre, spread = x[kept].mean(), np.sum((x[kept] - x[kept].mean()) ** 2)
    true_spread = spread - kept.sum() * gauge_error_mm**2
    too_small = scatter**2 < gauge_error_mm**2 * gain**2 * scipy.stats.chi2.ppf(_OUTLIER_PROBABILITY, count) / count
    if gauge_error_mm < 0.0 or too_small:
        pairs_mm = scatter / abs(gain)
        raise BadInput(
            f"gauge_error_mm is {gauge_error_mm:g}", f"0 to about {pairs_mm:.2g}, by which the pairs scatter"
        )
    if true_spread <= 0.5 * spread:
        raise BadInput(f"gauge_error_mm is {gauge_error_mm:g}", "small against the displacements' own spread")
    gain *= spread / true_spread
    offset = float(y[kept].mean() - gain * centre)
    residual = y - offset - gain * x
    quantile = float(scipy.stats.t.isf(0.025, count))
    gain_error = scatter / np.sqrt(spread)
    offset_error = scatter * np.sqrt(1.0 / kept.sum() + centre**2 / spread)
    refused = tuple(RefusedPair(labels[k], float(x[k]), float(y[k]), float(residual[k])) for k in np.flatnonzero(~kept))
    return Calibration(
        gain_v_per_mm=float(gain),
        gain_confidence_v_per_mm=float(quantile * gain_error),
        offset_v=offset,
        offset_confidence_v=float(quantile * offset_error),
        linearity_percent=float(100.0 * np.max(np.abs(residual[kept])) / np.ptp(y[kept])),
        displacement_mm=x[kept],
        voltage_v=y[kept],
        residual_v=residual[kept],
        refused=refused,
    )

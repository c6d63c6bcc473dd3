"""An identified plant with its uncertainty: what `model.json` holds and a design uses; and the numbers that it is
trusted by, each with its limit and what it decides.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray, frequencies
from tactuator.errors import BadInput
from tactuator.parameters import Flag, Number, Numbers, table
from tactuator.plain import brief
from tactuator.result import FREQUENCY, Chart, ChartLine, Fact, Result, data, fields_of, found
from tactuator.signals.decibels import db
from tactuator.signals.systems import ContinuousSystem

Decides = Literal["refuses trust", "narrows the valid range", "cannot tell"]


@table("trust")
class QualityCheck:
    """A number by which a model is judged. name, value, unit; limit: the most that is allowed, or the least where
    `least`; decides: what follows where the value is beyond its limit; where: the place or record it speaks of.
    """

    name: str
    value: Number
    unit: str
    limit: Number
    decides: Decides
    least: Flag = False
    where: str = ""

    @property
    def beyond(self) -> bool:
        """Return true where the value is not within its limit."""
        return self.value < self.limit if self.least else self.value > self.limit

    @property
    def refuses(self) -> bool:
        """Return true where the model is not to be trusted for this."""
        return self.beyond and self.decides == "refuses trust"

    @property
    def leaves_open(self) -> bool:
        """Return whether the record leaves this open."""
        return self.beyond and self.decides == "cannot tell"

    @property
    def measured(self) -> str:
        """Return the value with its unit."""
        return f"{self.value:.4g} {self.unit}".strip()

    @property
    def allowed(self) -> str:
        """Return the limit in words."""
        return f"{'at least' if self.least else 'at most'} {self.limit:g} {self.unit}".strip()

    def __str__(self) -> str:
        place = f", {self.where}" if self.where else ""
        return f"{self.name}{place}: {self.measured} ({self.allowed})"


def reasons(checks: Iterable[QualityCheck]) -> tuple[str, ...]:
    """Return why a model is not to be trusted, empty if it is."""
    return tuple(str(row) for row in checks if row.refuses)


Z95 = 1.959964
"""Half-width of 95 % of a normal distribution, in its standard deviations."""
DB = 20.0 / np.log(10.0)
"""Decibels of a change of one in a natural logarithm (8.686)."""


@table("excess", eq=False)
class Excess:
    """Standard deviations of the response's logarithm beyond the covariance's: what the record does not exclude, what
    the form cannot follow. frequency_hz ascending, magnitude (natural), phase_rad: (m,); ends hold beyond."""

    frequency_hz: Numbers
    magnitude: Numbers
    phase_rad: Numbers

    __repr__ = brief

    @classmethod
    def none(cls) -> Excess:
        """Return no excess at all."""
        return cls(np.ones(1), np.zeros(1), np.zeros(1))

    def joined(self, other: NDArray[Any]) -> Excess:
        """Return this with another deviation of the logarithm, (m,), added in squares."""
        return Excess(self.frequency_hz, np.hypot(self.magnitude, other.real), np.hypot(self.phase_rad, other.imag))

    def at(self, frequency_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return magnitude and phase at `frequency_hz` (any shape), straight between points of log frequency."""
        place = np.log(np.maximum(frequency_hz, 1e-300))
        known = np.log(self.frequency_hz)
        return np.interp(place, known, self.magnitude), np.interp(place, known, self.phase_rad)


_RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def polynomial(coefficients: Sequence[float] | FloatArray) -> str:
    """Return a polynomial in s in a line, four digits of each coefficient; coefficients: descending powers."""
    line = ""
    for power, value in zip(range(len(coefficients) - 1, -1, -1), coefficients, strict=True):
        if value:
            size = f"{abs(value):.4g}"
            s = "" if power == 0 else f"s{'' if power == 1 else str(power).translate(_RAISED)}"
            line += (" - " if value < 0 else " + ") + ("" if s and size == "1" else f"{size} " if s else size) + s
    return line.removeprefix(" + ").replace(" - ", "-", line.startswith(" - ")) or "0"


@table("model", eq=False)
class PlantModel(Result):
    """An identified plant. It draws its magnitude with its 95 % band.

    num, den: descending powers of s, den monic; delay_s: dead time.

    covariance: of (num[0..m], den[1..n], delay_s), (m + n + 2, m + n + 2), zero for what was not estimated. band_hz:
    where the record speaks of the plant. quantity: what the output is proportional to; units: of command and position.
    record, calibration, method: where it comes from. friction: Coulomb level and presliding, if any was found. excess:
    uncertainty beyond the covariance. valid_hz: where the record moved the mechanism and the band is narrow (None: not
    known); beyond it the model is a guess. trust: what it was judged by when it was found.
    """

    num: Numbers
    den: Numbers
    delay_s: Number
    covariance: Numbers
    band_hz: tuple[Number, Number]
    quantity: str = "displacement"
    command_unit: str = "V"
    position_unit: str = "V"
    method: str = "refined"
    record: dict[str, Any] = field(default_factory=dict)
    calibration: dict[str, Any] = field(default_factory=dict)
    friction: dict[str, Number] = field(default_factory=dict)
    excess: Excess = field(default_factory=Excess.none)
    valid_hz: tuple[Number, Number] | None = None
    trust: tuple[QualityCheck, ...] = ()

    __repr__ = Result.__repr__

    def __post_init__(self) -> None:
        size = self.num.size + self.den.size
        if self.covariance.shape != (size, size):
            raise BadInput(f"covariance has shape {self.covariance.shape}", f"({size}, {size})")

    def described(self) -> list[Fact]:
        """Return the transfer function in a line, four digits of each coefficient, and where it is valid."""
        num, den = polynomial(self.num), polynomial(self.den)
        above = f"({num})" if " " in num else num
        delay = f" exp(-{self.delay_s:.4g} s)" if self.delay_s > 0.0 else ""
        valid = self.valid_hz
        return [
            found("model", f"{above}/({den}){delay}"),
            *([] if valid is None else [found("valid", f"{valid[0]:.3g} to {valid[1]:.3g} Hz")]),
        ]

    def facts(self) -> Sequence[Fact]:
        """Return polynomials, dead time and band, and the fields."""
        return [
            *self.described(),
            found("dead time", 1e3 * self.delay_s, "ms"),
            found("band", f"{self.band_hz[0]:.3g} to {self.band_hz[1]:.3g} Hz"),
            *data(fields_of(self)),
        ]

    def chart(self, *measured: ChartLine) -> Chart:
        """Return the magnitude with its 95 % band, under what was measured."""
        hertz = np.geomspace(*self.band_hz, 300)
        unit = f"{self.position_unit or 'unit'}/{self.command_unit or 'unit'}"
        level, half = db(self.response(hertz)), self.band_db(hertz)
        drawn = ChartLine("model, with its 95 % band", hertz, level, half=half, colour=0)
        return Chart(FREQUENCY, f"magnitude (dB re 1 {unit})", [drawn, *measured], log_x=True)

    @property
    def distrust(self) -> tuple[str, ...]:
        """Return why the model is not to be trusted, empty if it is."""
        return reasons(self.trust)

    def with_checks(self, *rows: QualityCheck) -> PlantModel:
        """Return the model with more numbers that it was judged by."""
        return replace(self, trust=(*self.trust, *rows))

    @property
    def system(self) -> ContinuousSystem:
        """Return the model as a continuous system."""
        return ContinuousSystem.from_polynomials(self.num, self.den, self.delay_s)

    def response(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """Return the complex response at `frequency_hz` (any shape)."""
        s = 2j * np.pi * frequencies(frequency_hz)
        return np.asarray(np.polyval(self.num, s) / np.polyval(self.den, s) * np.exp(-s * self.delay_s))

    def band_db(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return the 95 % half-width of the magnitude in dB at `frequency_hz` (m,).

        It holds the covariance, carried over to first order, and the excess.
        """
        return np.asarray(Z95 * DB * self._deviations(frequency_hz)[0])

    def band_rad(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return the 95 % half-width of the phase at `frequency_hz` (m,)."""
        return np.asarray(Z95 * self._deviations(frequency_hz)[1])

    def _deviations(self, frequency_hz: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the standard deviations of the logarithm of the response: real part, imaginary part."""
        frequency = np.atleast_1d(frequencies(frequency_hz))
        gradient, sizes = self._log_gradient(frequency), self._sizes()
        relative = self._relative_covariance()
        deviations = []
        for part, beyond in zip((gradient.real, gradient.imag), self.excess.at(frequency), strict=True):
            scaled = part * sizes
            variance = np.einsum("ij,jk,ik->i", scaled, relative, scaled)
            deviations.append(np.sqrt(np.maximum(variance, 0.0) + beyond**2))
        return deviations[0], deviations[1]

    def holding(self, other: PlantModel) -> PlantModel:
        """Return the model with a band that holds another one, its band included, at the frequencies of the excess."""
        table = self.excess.frequency_hz
        apart = np.log(other.response(table) / self.response(table))
        off = np.abs(apart.real) + 1j * np.abs(apart.imag)
        beside = other.band_db(table) * np.log(10.0) / 20.0 + 1j * other.band_rad(table)
        return replace(self, excess=self.excess.joined((off + beside) / Z95))

    def confidence(self) -> dict[str, float]:
        """Return the 95 % half-widths: of the gain num[-1]/den[-1], of each coefficient, of the dead time."""
        errors = Z95 * np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        m, n = self.num.size - 1, self.den.size - 1
        widths = {f"num_s{m - k}": float(errors[k]) for k in range(m + 1)}
        widths |= {f"den_s{n - 1 - k}": float(errors[m + 1 + k]) for k in range(n)}
        return {"gain": self._gain_confidence(), **widths, "delay_s": float(errors[-1])}

    def family(self, count: int, rng: np.random.Generator) -> tuple[ContinuousSystem, ...]:
        """Return `count` plants drawn from the covariance, for a design that must hold for all; stable as the model is.

        The first two are the ends of the most uncertain direction, 2 standard errors away, if those are of the kind.
        """
        values, vectors = np.linalg.eigh(self._relative_covariance())
        spread = vectors * np.sqrt(np.maximum(values, 0.0))
        systems: list[ContinuousSystem] = []
        for sign in (2.0, -2.0):
            self._append(systems, sign * spread[:, -1], count)
        for _ in range(50 * count):
            if len(systems) >= count:
                break
            self._append(systems, spread @ rng.standard_normal(values.size), count)
        return tuple(systems)

    def _append(self, systems: list[ContinuousSystem], change: FloatArray, count: int) -> None:
        theta = np.concatenate([self.num, self.den[1:], [self.delay_s]]) + change * self._sizes()
        m = self.num.size
        system = ContinuousSystem.from_polynomials(theta[:m], np.append(1.0, theta[m:-1]), max(float(theta[-1]), 0.0))
        if len(systems) < count and system.is_stable == self.system.is_stable:
            systems.append(system)

    def _sizes(self) -> FloatArray:
        errors = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return np.where(errors > 0.0, errors, 1.0)

    def _relative_covariance(self) -> FloatArray:
        return np.asarray(self.covariance / np.outer(self._sizes(), self._sizes()))

    def _gain_confidence(self) -> float:
        """Return the 95 % half-width of num[-1]/den[-1], or of num[0] where the plant integrates."""
        m = self.num.size - 1
        if self.den[-1] == 0.0:
            return float(Z95 * np.sqrt(max(self.covariance[0, 0], 0.0)))
        gradient = np.zeros(self.covariance.shape[0])
        gradient[m] = 1.0 / self.den[-1]
        gradient[-2] = -self.num[-1] / self.den[-1] ** 2
        return float(Z95 * np.sqrt(max(float(gradient @ self.covariance @ gradient), 0.0)))

    def _log_gradient(self, frequency_hz: FloatArray) -> NDArray[np.complex128]:
        s = 2j * np.pi * frequency_hz
        numerator, denominator = np.polyval(self.num, s), np.polyval(self.den, s)
        m, n = self.num.size - 1, self.den.size - 1
        by_num = [s ** (m - k) / numerator for k in range(m + 1)]
        by_den = [-(s ** (n - 1 - k)) / denominator for k in range(n)]
        return np.stack([*by_num, *by_den, -s], axis=-1)

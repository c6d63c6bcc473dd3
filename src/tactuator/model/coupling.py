"""Coupling of a display's channels: the table [coupling], by a mechanism or by a measured matrix of responses.

The share K_ij is the command of channel i, in volts, that would move channel i as one volt of the command of channel j
moves it; K_ii is zero. The displays' plants P_i (command to sensor) so become P_i (u_i + sum_j K_ij u_j), whatever the
way by which the force or the motion gets there.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import permutations
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.parameters import Number, Numbers, Positive, Wording, from_table, kept_by, table
from tactuator.signals.systems import ContinuousSystem

RADIUS = 1.73
"""Radius, in standard deviations of a complex number, of the disk that holds it with 95 %: the root of ln 20."""
_FEWEST = 4
_LENGTHS, _SIZES = np.geomspace(0.1, 6.0, 10), np.geomspace(0.1, 30.0, 6)
"""Lengths of the process that are tried, octaves, and its powers, in terms of that of the shares."""
_TOLD = 0.5
"""Share of the process's power that the data may leave open at a line which its neighbours tell."""
_NESTED: TypeAdapter[Any] = TypeAdapter(list[list[list[Number]]], config=ConfigDict(defer_build=True))


def _matrices(value: Any) -> FloatArray:
    if not isinstance(value, np.ndarray):
        try:
            _NESTED.validate_python(value)
            value = np.array(value, dtype=np.float64)
        except (ValidationError, ValueError):
            raise BadInput("no list of square matrices", "a list of matrices of numbers") from None
    if value.ndim != 3 or value.shape[1] != value.shape[2] or not np.all(np.isfinite(value)):
        raise BadInput(f"of shape {value.shape}", "(frequencies, channels, channels), finite")
    return np.asarray(value, dtype=np.float64)


Matrices = Annotated[FloatArray, *kept_by(_matrices, "a list of square matrices")]


@table("coupling", eq=False)
class CoupledResponse:
    """A measured matrix of responses: from the command of each channel (V) to the sensor of each (V).

    frequency_hz: ascending, (m,). real, imag, deviation: (m, out, in); deviation is the standard deviation of the
    complex number.
    """

    channels: tuple[str, ...]
    frequency_hz: Numbers
    real: Matrices
    imag: Matrices
    deviation: Matrices

    def __post_init__(self) -> None:
        shape = (self.frequency_hz.size, len(self.channels), len(self.channels))
        if self.frequency_hz.ndim != 1 or self.frequency_hz.size < _FEWEST:
            raise BadInput(f"{self.frequency_hz.size} frequencies", f"{_FEWEST} or more in one list")
        if self.frequency_hz[0] <= 0.0 or np.any(np.diff(self.frequency_hz) <= 0.0):
            raise BadInput("the frequencies do not ascend from above zero", "ones that do", key="frequency_hz")
        for name in ("real", "imag", "deviation"):
            if getattr(self, name).shape != shape:
                raise BadInput(f"of shape {getattr(self, name).shape}", f"{shape}", key=name)
        if np.any(self.deviation < 0.0) or np.any(self._diagonal() == 0.0):
            raise BadInput("a deviation below zero, or a channel that does not answer itself", "neither")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, CoupledResponse):
            return NotImplemented
        return self.channels == other.channels and all(
            np.array_equal(getattr(self, name), getattr(other, name))
            for name in ("frequency_hz", "real", "imag", "deviation")
        )

    def __hash__(self) -> int:
        return hash((self.channels, self.real.tobytes()))

    def _diagonal(self) -> ComplexArray:
        return np.asarray(np.einsum("mii->mi", self.value))

    @property
    def value(self) -> ComplexArray:
        """Return the responses, (m, out, in), volts of the sensor per volt of command."""
        return np.asarray(self.real + 1j * self.imag)

    def shares(self) -> tuple[ComplexArray, FloatArray]:
        """Return K and its standard deviation as measured, line by line, (m, out, in) each."""
        ahead = self._diagonal()[:, :, None]
        off = 1.0 - np.eye(len(self.channels))
        return off * self.value / ahead, off * self.deviation / np.abs(ahead)


@lru_cache(maxsize=16)
def smooth_shares(response: CoupledResponse) -> tuple[ComplexArray, FloatArray]:
    """Return K and its standard deviation at the measured frequencies, (m, out, in) each, every line with what its
    neighbours say.

    A Gaussian process over the logarithm of frequency with a Matern kernel (nu = 5/2), whose length and size are those
    of the greatest likelihood (Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, chapters 2 and 5).
    Lines of which the data tell less than the process supposes are left as they were measured.
    """
    shares, deviation = response.shares()
    place = np.log2(response.frequency_hz)
    apart = np.abs(place[:, None] - place)
    for out, of in permutations(range(len(response.channels)), 2):
        pair = shares[:, out, of].copy(), deviation[:, out, of].copy()
        shares[:, out, of], deviation[:, out, of] = _smoothed(apart, *pair)
    return shares, deviation


def _smoothed(apart: FloatArray, value: ComplexArray, deviation: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """Return values (m,) and deviations by the most likely process; apart: distances in octaves, (m, m)."""
    noise = np.maximum(deviation, 1e-9 * np.max(np.abs(value)))
    weight = noise**-4.0
    power = float(np.sum(weight * (np.abs(value) ** 2 - noise**2)) / np.sum(weight))
    power = max(power, float(np.sum(weight)) ** -0.5)
    likeliest, best = -np.inf, (value, deviation)
    for length in _LENGTHS:
        steps = np.sqrt(5.0) * apart / length
        kernel = (1.0 + steps + steps**2 / 3.0) * np.exp(-steps)
        for size in _SIZES:
            prior = size * power * kernel
            lower = np.linalg.cholesky(prior + np.diag(noise**2))
            white = np.linalg.solve(lower, value)
            likely = -2.0 * float(np.sum(np.log(np.diag(lower)))) - float(np.sum(np.abs(white) ** 2))
            if likely > likeliest:
                across = np.linalg.solve(lower, prior)
                rest = np.maximum(size * power - np.sum(across**2, axis=0), 0.0)
                known = rest < _TOLD * size * power
                smooth = np.where(known, across.T @ white, value)
                likeliest, best = likely, (smooth, np.where(known, np.sqrt(rest), deviation))
    return best


def measured_of(value: Any) -> CoupledResponse:
    """Return a measured coupling, or that of its table. Raises BadInput for what is none."""
    if isinstance(value, CoupledResponse):
        return value
    if not isinstance(value, dict):
        raise BadInput(f"{value!r}", "the path of a file that `identify` wrote")
    return from_table(CoupledResponse, value, "[coupling]", "measured")


_IN_PLACE = Wording(default="none")


@table("[coupling]")
class Coupling:
    """How the channels of a display act on one another: not at all, through a frame, or as it was measured."""

    level_db: Annotated[
        Number | None,
        Wording("a number below 0", default="none"),
        Field(
            lt=0.0,
            description="share of each motor's force that the common frame hands to every other channel at low "
            "frequencies; the simulated display obeys it",
        ),
    ] = None
    resonance_hz: Annotated[Positive, Field(description="of the frame, beyond which it hands on less and less")] = 300.0
    damping: Annotated[Positive, Field(description="damping ratio of the frame's resonance")] = 0.5
    measured: Annotated[
        CoupledResponse | None,
        *kept_by(lambda value: None if value is None else measured_of(value), "the path of a file"),
        _IN_PLACE,
        Field(
            description="a coupling file of `identify` (a path beside this file), by which the verdict judges in place "
            "of `level_db`; the simulated display does not obey it"
        ),
    ] = None

    def __post_init__(self) -> None:
        if self.level_db is not None and self.measured is not None:
            raise BadInput("given beside measured", "one of them", key="level_db")

    @property
    def is_there(self) -> bool:
        """Tell whether the file says anything of a coupling."""
        return self.level_db is not None or self.measured is not None

    def path(self) -> ContinuousSystem:
        """Return the frame: from a motor's force to what arrives at another channel, without the share; 1 at rest."""
        omega = 2.0 * np.pi * self.resonance_hz
        return ContinuousSystem.from_polynomials([omega**2], [1.0, 2.0 * self.damping * omega, omega**2])

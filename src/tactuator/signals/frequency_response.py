"""A frequency response of a mechanism as others give it: values, or magnitudes alone, with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """A response at some frequencies, with the uncertainty of its magnitudes.

    frequency_hz ascending, magnitude (position's unit over the command's), phase_rad or None, deviation: relative
    standard error of the magnitude; all (m,). about: where it comes from. remarks: what had to be assumed; assumed: is
    the deviation a guess?
    """

    frequency_hz: FloatArray
    magnitude: FloatArray
    phase_rad: FloatArray | None
    deviation: FloatArray
    about: dict[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    assumed: bool = False

    def __post_init__(self) -> None:
        if self.frequency_hz.size < 4:
            raise BadInput(f"a response at {self.frequency_hz.size} frequencies", "4 or more")
        if np.any(np.diff(self.frequency_hz) <= 0.0) or self.frequency_hz[0] <= 0.0:
            raise BadInput("the response's frequencies do not ascend from above zero", "ones that do")
        if np.any(self.magnitude <= 0.0):
            raise BadInput("a magnitude of the response is zero or below", "above zero (dB: in a column _db)")

    def value(self) -> NDArray[np.complex128]:
        """Return the complex response, (m,); of magnitudes alone that of least phase."""
        phase = minimum_phase(self.frequency_hz, self.magnitude) if self.phase_rad is None else self.phase_rad
        return np.asarray(self.magnitude * np.exp(1j * phase))


def minimum_phase(frequency_hz: FloatArray, magnitude: FloatArray) -> FloatArray:
    """Return the phase, radians, of the stable response with that magnitude and the least phase, (m,).

    Bode's relation: 1/pi times the integral of the slope d log|G| / d log f, weighted by log coth |u/2|, u the distance
    in log frequency. Beyond its ends the magnitude goes on with its end slopes. Source: Bode, Network Analysis and
    Feedback Amplifier Design, 1945, chapter 14.
    """
    place, level = np.log(frequency_hz), np.log(magnitude)
    ends = [np.polyfit(place[part], level[part], 1)[0] for part in (slice(0, 3), slice(-3, None))]
    grid = np.arange(place[0] - 8.0, place[-1] + 8.0, 0.01)
    along = np.interp(grid, place, level)
    along = np.where(grid < place[0], level[0] + ends[0] * (grid - place[0]), along)
    along = np.where(grid > place[-1], level[-1] + ends[1] * (grid - place[-1]), along)
    slope = np.diff(along) / np.diff(grid)
    middle = 0.5 * (grid[1:] + grid[:-1])
    made = []
    for at in place:
        # half a step off a singularity that can be integrated
        away = np.maximum(np.abs(middle - at), 0.0025)
        made.append(float(np.sum(slope * np.log(1.0 / np.tanh(0.5 * away)) * 0.01)) / np.pi)
    return np.array(made)

"""Was the mechanism excited? Order of persistent excitation of a command, and what it allows to identify."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput

_FLOOR = 1e-8
"""Power of a line, over the strongest, below which it does not count: 80 dB."""


@dataclass(frozen=True)
class ExcitationReport:
    """A command's excitation. order: lines of the command's two-sided spectrum, and so the number of parameters it can
    determine (Ljung, System Identification, 1999, section 13.2). needed: parameters of the model. condition: of the
    information matrix, each parameter in its own unit size (nan before there is a model). low_hz, high_hz: 99.8 % of
    the power.
    """

    order: int
    needed: int
    condition: float
    low_hz: float
    high_hz: float

    @property
    def sufficient(self) -> bool:
        """Tell whether there are lines enough for the parameters, and an information matrix that can be inverted."""
        return self.order >= self.needed and not self.condition > 1e12


def excitation_report(
    command: FloatArray, rate_hz: float, needed: int, condition: float = float("nan")
) -> ExcitationReport:
    """Return how many independent parameters `command` (n,) can determine."""
    centred = command - command.mean()
    power = np.abs(np.fft.rfft(_window(command.size) * centred)) ** 2
    power[:4] = 0.0
    strongest = float(power.max(initial=0.0))
    if not strongest > 1e-24 * command.size**2 * max(float(np.max(np.abs(command))), 1e-300) ** 2:
        return ExcitationReport(0, needed, condition, 0.0, 0.0)
    above = np.concatenate([[False], power > _FLOOR * strongest, [False]]).astype(np.int8)
    edges = np.flatnonzero(np.diff(above))
    lengths = edges[1::2] - edges[::2]
    # the window spreads one line over about eight bins
    order = int(2 * np.sum(np.maximum(1, lengths - 8)))
    share = np.cumsum(power) / power.sum()
    frequency = np.arange(power.size) * rate_hz / command.size
    low, high = np.searchsorted(share, [0.001, 0.999])
    return ExcitationReport(
        order, needed, condition, float(frequency[low]), float(frequency[min(high, power.size - 1)])
    )


def _window(count: int) -> FloatArray:
    """Return Blackman and Harris' window of four terms (1978), (count,): a polynomial of one cosine."""
    c = np.cos(np.linspace(0.0, 2.0 * np.pi, count))
    # a0 - a1 cos x + a2 cos 2x - a3 cos 3x
    return np.asarray(((-4.0 * 0.01168 * c + 2.0 * 0.14128) * c - 0.48829 + 3.0 * 0.01168) * c + 0.35875 - 0.14128)


def require_excitation(report: ExcitationReport) -> None:
    """Refuse to identify what was not excited."""
    if report.order < report.needed:
        raise BadInput(
            f"the command excites order {report.order}, the model has {report.needed} parameters",
            f"a command of order {report.needed} or more (steps, noise, several sinusoids)",
        )
    if not report.sufficient:
        raise BadInput(
            f"the record cannot tell the model's {report.needed} parameters apart (condition {report.condition:.1g})",
            "a livelier command, or a lower order",
        )

"""Requirements on a display: the tables [feedback], [prefilter] and [objectives] of a display file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tactuator.errors import BadInput
from tactuator.signals.systems import ContinuousSystem

Structure = Literal["integrator-lead-lag", "paper", "none"]


@dataclass(frozen=True)
class FeedbackRequirements:
    """Requirements that the loop must keep under every load; None or an empty tuple asks nothing.

    phase_margin_deg: at least. sensitivity_peak: max|S|, at most. mains_max_db: |T| at `mains_hz`, at most.
    rejection_max_db: |S| at `rejection_hz`, at most. command_noise_gain_max: rms of CS for white sensor noise.
    rejection_band_hz: what is left to choose minimises the mean of |S| in dB over it, even in log frequency.
    controller: C itself, where structure is "paper" (None: the paper's own).
    """

    structure: Structure = "integrator-lead-lag"
    phase_margin_deg: float | None = 50.0
    sensitivity_peak: float | None = 1.45
    mains_hz: tuple[float, ...] = ()
    mains_max_db: tuple[float, ...] = ()
    rejection_hz: tuple[float, ...] = ()
    rejection_max_db: tuple[float, ...] = ()
    command_noise_gain_max: float | None = 30.0
    rejection_band_hz: tuple[float, float] = (0.4, 10.0)
    controller: ContinuousSystem | None = None

    def __post_init__(self) -> None:
        for name in ("mains", "rejection"):
            frequencies, limits = getattr(self, f"{name}_hz"), getattr(self, f"{name}_max_db")
            if len(frequencies) != len(limits):
                raise BadInput(
                    f"feedback: {len(frequencies)} {name}_hz and {len(limits)} {name}_max_db", "as many of each"
                )
        low, high = self.rejection_band_hz
        if not 0.0 < low < high:
            raise BadInput(f"feedback: rejection_band_hz is [{low:g}, {high:g}]", "0 < low < high")


@dataclass(frozen=True)
class PrefilterRequirements:
    """Requirements on the prefilter. poles: its number of poles. falls_above_hz: beyond it nothing is passed harder
    than the strongest frequency in the band.
    """

    poles: int = 4
    falls_above_hz: float = 400.0

    def __post_init__(self) -> None:
        if not 2 <= self.poles <= 16:
            raise BadInput(f"prefilter: poles is {self.poles}", "2 to 16")


@dataclass(frozen=True)
class Objectives:
    """Tolerances of the paper's four objectives (its section 2).

    flatness_db: i, |H| against the curve over the band. mains_max_db_sl: ii, felt level of every mains line.
    noise_max_db_sl, resonance_peak: iii, felt noise in every third octave, max|T|. load_max_db over frequencies up to
    load_band_hz: iv, |H| with a load against without. comfort_db_sl: the greatest level to be presented.
    """

    flatness_db: float = 1.0
    mains_max_db_sl: float = 0.0
    noise_max_db_sl: float = 0.0
    resonance_peak: float = 1.3
    load_max_db: float = 1.0
    load_band_hz: float = 10.0
    comfort_db_sl: float = 55.0

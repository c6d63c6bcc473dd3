"""Hum and noise of a channel's sensor by itself, told apart from the motion: what `[environment]` of a display states.

The reading y of a display at rest is the sensor's own n and the motion P u that the command makes of it. Command and
reading are both known, so that n = y - P u, line by line; far above the loop's bandwidth nothing moves, and y is n.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.description import Channel
from tactuator.signals.discretise import zero_order_hold
from tactuator.signals.spectra import lock_in, mains_multiples, power_spectrum
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.felt import beside_friction

_QUIET_BAND = (0.25, 0.45)
"""Of the rate: where the density of the noise is read."""
_SEEN = 4.0
"""A line counts from this many standard errors on."""


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """Hum and noise of a sensor.

    hum_hz, hum_v_peak (k,): the mains lines that stand out, volts peak. noise_v_rms: white noise, the converter's steps
    taken out.
    """

    hum_hz: FloatArray
    hum_v_peak: FloatArray
    noise_v_rms: float

    def keys(self) -> dict[str, Any]:
        """Return the figures as keys of [environment]."""
        return {
            "hum_hz": self.hum_hz.tolist(),
            "hum_v_peak": self.hum_v_peak.tolist(),
            "noise_v_rms": self.noise_v_rms,
        }

    def environment(self) -> str:
        """Return the keys of [environment] that say so, as a display file has them."""
        lines = ", ".join(f"{one:g}" for one in self.hum_hz)
        levels = ", ".join(f"{one:.3g}" for one in self.hum_v_peak)
        return f"hum_hz = [{lines}], hum_v_peak = [{levels}], noise_v_rms = {self.noise_v_rms:.3g}"


def sensor_noise(
    position_v: FloatArray,
    command_v: FloatArray,
    rate_hz: float,
    channel: Channel,
    plant: ContinuousSystem,
    mains_hz: float | None = 60.0,
) -> SensorNoise:
    """Return what the sensor adds to a display at rest.

    position_v, command_v: (n,), of one trace, volts at the sensor and of the command; plant: from one to the other.
    """
    spectrum = power_spectrum(position_v, rate_hz, 1.0)
    low, high = (share * rate_hz for share in _QUIET_BAND)
    quiet = (spectrum.frequency_hz > low) & (spectrum.frequency_hz < high)
    power = float(np.median(spectrum.density[quiet])) * 0.5 * rate_hz
    lines = mains_multiples(mains_hz, min(channel.threshold.band_hz[1], 0.45 * rate_hz))
    if lines.size == 0:
        return SensorNoise(lines, lines, _without_steps(power, channel))
    still = np.zeros(lines.shape)
    moved = beside_friction(channel.environment, zero_order_hold(plant, rate_hz).response(lines), still)
    own = np.abs(lock_in(position_v, lines, rate_hz) - moved * lock_in(command_v, lines, rate_hz))
    seen = own > _SEEN * np.sqrt(2.0 * power / position_v.size)
    return SensorNoise(lines[seen], own[seen], _without_steps(power, channel))


def _without_steps(power: float, channel: Channel) -> float:
    return float(np.sqrt(max(power - channel.converter.step_v**2 / 12.0, 0.0)))

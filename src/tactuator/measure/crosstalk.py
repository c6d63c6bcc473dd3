"""Crosstalk: what is felt on the other fingers while one channel is driven.

One channel plays a tone, the controller holds the others at rest, and a lock-in at the tone's frequency reads all of
them: at the finger ports where the rig has them, else by the sensors. What differs between blocks of the tone is noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.measure.error import DITHERED
from tactuator.measure.lines import Lines, Play, Tone, measure_lines, reference_on
from tactuator.measure.options import MeasurementOptions
from tactuator.measure.response import Progress, check_frequencies
from tactuator.rig.rig import Rig, require_sensors, with_felt
from tactuator.signals.decibels import db, from_db, half_width_db
from tactuator.signals.multisine import tones

_LEAST = 1e-5
"""Half-width at least, of the threshold: no gauge reads a motion 100 dB below it."""


@dataclass(frozen=True)
class FeltLevel:
    """Level of a tone on one finger, dB SL, with its 95 % half-width; or what it is below, where noise hides it."""

    level_db_sl: float | None
    confidence_db: float | None
    below_db_sl: float | None

    @classmethod
    def of(cls, size: float, half_width: float, threshold: float) -> FeltLevel:
        """Return the level of a motion that is known to a half-width, all three in one unit."""
        half_width = max(half_width, _LEAST * threshold)
        confidence_db = float(half_width_db(size, half_width))
        # half-width up to which a level is reported: the motion is then three times its half-width, which noise alone
        # reaches in one of 15,000 cases (of eight blocks)
        if confidence_db <= 2.5:
            return cls(float(db(size / threshold)), confidence_db, None)
        return cls(None, None, float(db((size + half_width) / threshold)))

    @property
    def at_most_db_sl(self) -> float:
        """Return the level, or what it is below."""
        level_db_sl = self.below_db_sl if self.level_db_sl is None else self.level_db_sl
        assert level_db_sl is not None
        return level_db_sl

    @property
    def words(self) -> str:
        """Return the level as it is read."""
        if self.level_db_sl is None:
            return f"below {self.below_db_sl:.1f}"
        return f"{self.level_db_sl:.2f} ± {max(self.confidence_db or 0.0, 0.01):.2g}"


@dataclass(frozen=True)
class Crosstalk:
    """Levels on the fingers that can be read, by channel, while one channel plays a tone; its own is among them.

    saturated: a limit was reached on one of them.
    """

    driven: str
    load: str
    frequency_hz: float
    levels: dict[str, FeltLevel]
    saturated: bool

    @property
    def others(self) -> dict[str, FeltLevel]:
        """Return the levels of the channels that are not driven."""
        return {name: level for name, level in self.levels.items() if name != self.driven}


def felt_elsewhere(
    rig: Rig, driven: str, frequency_hz: ArrayLike, options: MeasurementOptions, *, progress: Progress | None = None
) -> tuple[Crosstalk, ...]:
    """Drive one channel under the loaded controller; return what is felt on all that have a finger port or a sensor.

    Each frequency (m,) is played, kept off mains as by `stepped_sine`, until every other channel is surely below
    threshold or known to the confidence asked for, or for longest_s. progress: called with the number of frequencies
    done and of all. Raises BadInput as `stepped_sine` does, and where no other channel can be read.
    """
    at_ports = rig.has_finger_ports
    others = [name for name in rig.channels if name != driven]
    if not others:
        raise BadInput(f"channel {driven!r} is the only one", "a display with another")
    unread = () if at_ports else rig.without_sensor
    if set(others) <= set(unread):
        require_sensors(rig, others)
    names = [name for name in rig.channels if name not in unread]
    columns = [rig.channels.index(name) for name in names]
    check_frequencies(rig, frequency_hz, options.band_hz)
    frequencies = tones(frequency_hz, options.mains_hz, options.band_hz or (0.0, 0.45 * rig.rate_hz))
    channels = [rig.display.channel(name) for name in names]
    steps_v, noise_v = np.array([(each.converter.step_v, each.environment.noise_v_rms) for each in channels]).T
    # a sensor with little noise does not read a motion within a step of the A/D
    hidden_v = np.where((noise_v < DITHERED * steps_v) & (not at_ports), 0.5 * steps_v, 0.0)
    is_other = np.array(names) != driven
    play, peak = reference_on(rig, [rig.channels.index(driven)]), float(from_db(options.level_db_sl))
    play = _at_ports(rig, play) if at_ports else play
    rows: list[Crosstalk] = []
    for hertz in frequencies.tolist():
        curves = (each.threshold.curve.displacement_mm if at_ports else each.threshold_voltage for each in channels)
        threshold = np.array([float(curve(hertz)) for curve in curves])

        def doubt_db(found: Lines, threshold: FloatArray = threshold) -> FloatArray:
            half_width = found.half_width[:, 0]
            is_open = np.abs(found.amplitude[:, 0]) + half_width + hidden_v > threshold
            return np.where(is_other & is_open & (half_width > 0.0), found.confidence_db[:, 0], 0.0)

        tone = Tone(hertz, peak, rig.rate_hz, options.mains_hz)
        found = measure_lines(play, rig.rate_hz, columns, tone, options, doubt_db)
        motions = zip(np.abs(found.amplitude[:, 0]), found.half_width[:, 0] + hidden_v, threshold, strict=True)
        levels = dict(zip(names, (FeltLevel.of(*motion) for motion in motions), strict=True))
        rows.append(Crosstalk(driven, options.load, hertz, levels, bool(np.any(found.saturated))))
        if progress is not None:
            progress(len(rows), frequencies.size)
    rig.rest()
    return tuple(rows)


def _at_ports(rig: Rig, play: Play) -> Play:
    """Return what plays so, and in whose traces position_v is what the finger ports feel, millimetres."""
    return lambda waves: (replace(trace, position_v=moved_mm) for trace, moved_mm in with_felt(rig, play(waves)))

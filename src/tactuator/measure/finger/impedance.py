"""Impedance of what touches a display, from the same multisines played free and touched.

The plant under a load Z is P0/(1 + P0 Z), so that Z = 1/P_touched - 1/P_free whatever P0 is: errors of the plant's
model cancel. Friction depends on the motion. What is played to the finger is therefore made stronger where the finger
takes from it, so that the display moves as it did free, and its friction cancels too. A response is the ratio of two
spectra over whole periods, which holds in a closed loop too (Pintelon and Schoukens, System Identification: A Frequency
Domain Approach, 2012, chapter 4). A command at its limit does no harm, since what was put out is known; a reading at
its limit does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.model.description import Channel
from tactuator.perception.curve import check_level
from tactuator.rig.rig import Rig
from tactuator.signals.decibels import from_db
from tactuator.signals.multisine import Periods, multisine, odd_lines

REPEATS = 3
"""Periods of a realisation; the first settles."""
_EVENED_MAX = 2.0
"""Factor by which a line is played stronger or weaker to a finger than free, at most."""
_PERIOD_S = 1.0
_LINES = 32
_FEWEST = 4


@dataclass(frozen=True, eq=False)
class FingerPlan:
    """Realisations of a multisine: when they are periodic, and the references (realisations, period) of all channels,
    or of each (realisations, period, channels)."""

    periods: Periods
    waves: FloatArray
    rate_hz: float

    @property
    def frequency_hz(self) -> FloatArray:
        """Return the excited frequencies, hertz, (m,)."""
        return np.asarray(self.periods.lines * self.rate_hz / self.periods.period)

    @property
    def tried(self) -> FingerPlan:
        """Return the plan of the first realisation alone."""
        return replace(self, periods=replace(self.periods, realisations=1), waves=self.waves[:1])

    def evened(self, factor: ComplexArray) -> FingerPlan:
        """Return the plan with the lines of each channel times a factor (channels, m)."""
        size = np.abs(factor)
        factor = factor * np.clip(size, 1.0 / _EVENED_MAX, _EVENED_MAX) / size
        spectra = np.zeros((len(self.waves), self.periods.period // 2 + 1, len(factor)), dtype=np.complex128)
        lines = self.periods.lines
        spectra[:, lines] = np.fft.rfft(self.waves)[:, lines, None] * factor.T
        return replace(self, waves=np.fft.irfft(spectra, self.periods.period, axis=1))


@dataclass(frozen=True, eq=False)
class FingerPlay:
    """Spectra of command and position at the lines, (channels, realisations, m), and whose readings came to the
    converter's end, (channels,)."""

    command: ComplexArray
    position: ComplexArray
    ended: tuple[bool, ...]

    @property
    def response(self) -> ComplexArray:
        """Return what position there is for a command, (channels, realisations, m)."""
        return np.asarray(self.position / self.command)


def plan_play(
    rate_hz: float, band_hz: tuple[float, float], level_db_sl: float, seconds: float, rng: np.random.Generator
) -> FingerPlan:
    """Return multisines of lines at `level_db_sl` each: all of them free, the first and all of them touched take at
    most `seconds`.

    Raises BadInput for less time than four realisations take, a band with too few lines, or a level that may not be
    asked for.
    """
    check_level(level_db_sl)
    period = round(_PERIOD_S * rate_hz)
    count = (int(seconds * rate_hz / (REPEATS * period)) - 1) // 2
    if count < _FEWEST:
        least = (2 * _FEWEST + 1) * REPEATS * _PERIOD_S
        raise BadInput(f"{seconds:g} s for both states", f"{least:g} s or more")
    lines = odd_lines(band_hz, rate_hz, period, _LINES, rng)
    peak = float(from_db(level_db_sl))
    waves = [multisine(rate_hz, period, lines, peak, rng).one_period() for _ in range(count)]
    return FingerPlan(Periods(period, REPEATS, count, lines), np.array(waves), rate_hz)


def play_plan(rig: Rig, plan: FingerPlan, channels: Sequence[Channel]) -> FingerPlay:
    """Play the plan on channels of the rig at once; return what is heard of it.

    Raises BadInput where nothing is put out.
    """
    columns = [rig.channels.index(channel.name) for channel in channels]
    waves = plan.waves if plan.waves.ndim == 3 else plan.waves[:, :, None]
    reference = np.zeros((plan.periods.samples, len(rig.channels)))
    reference[:, columns] = np.repeat(waves, REPEATS, axis=0).reshape(plan.periods.samples, -1)
    trace = rig.play(reference)
    rig.rest()
    spectra: list[tuple[ComplexArray, ComplexArray]] = []
    ended = []
    for channel, column in zip(channels, columns, strict=True):
        command, position = (
            np.fft.rfft(plan.periods.blocks(values[:, column]).mean(axis=1))[:, plan.periods.lines]
            for values in (trace.command_v, trace.position_v)
        )
        if not np.all(np.abs(command) > 0.0):
            raise BadInput(f"channel {channel.name!r}: no command was put out", "a rig that plays")
        spectra.append((command, position))
        end_v = channel.converter.range_v - 1.5 * channel.converter.step_v
        ended.append(bool(np.max(np.abs(trace.position_v[:, column])) >= end_v))
    command, position = (np.array(part) for part in zip(*spectra, strict=True))
    return FingerPlay(command, position, tuple(ended))


def finger_impedance(channel: Channel, plan: FingerPlan, free: ComplexArray, touched: ComplexArray) -> ComplexArray:
    """Return the impedance in the units of a load of the display file, (realisations, m); free, touched: position over
    command, the same shape. A held command acts half a sample late, and a little less the higher its frequency.

    Raises BadInput for a channel whose sensor does not give the displacement.
    """
    if channel.quantity != "displacement":
        raise BadInput(f"channel {channel.name!r} measures the {channel.quantity}", "the displacement")
    f = plan.frequency_hz
    hold = np.sinc(f / plan.rate_hz) * np.exp(-2j * np.pi * f * (0.5 / plan.rate_hz + channel.plant.delay_s))
    return np.asarray(channel.plant.gain * hold * (1.0 / touched - 1.0 / free))

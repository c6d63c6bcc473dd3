"""Disturbance of the position by a finger that presses, lifts or trembles, and the part of it that the loop
takes away.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.measure.error import ChannelPrediction
from tactuator.measure.lines import Tone, measure_lines
from tactuator.measure.options import EXCURSION_MM, MAINS_HZ, MeasurementOptions
from tactuator.measure.response import check_frequencies
from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.model.plant import DERIVATIVES
from tactuator.plain import brief
from tactuator.rig.rig import Rig, Trace
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.excitation import ramps
from tactuator.signals.spectra import lock_in, off_mains
from tactuator.signals.systems import SampledSystem

TREMOR_HZ = (4.0, 12.0)
"""Band of a finger's tremor (physiological 8-12 Hz, pathological from 4 Hz)."""

_REJECTION = MeasurementOptions(longest_s=4.0)
"""Confidence (0.25 dB) and time of each force of a rejection."""


@dataclass(frozen=True, eq=False)
class Rejection:
    """Rejection of a force at frequency_hz (m,): |S|, dB, with 95 % half-widths; force_v: peak of the press, (m,)."""

    frequency_hz: FloatArray
    measured_db: FloatArray
    confidence_db: FloatArray
    expected_db: FloatArray
    force_v: FloatArray
    saturated: NDArray[np.bool_]


@dataclass(frozen=True)
class Press:
    """A finger that presses for a second and lifts: peak excursion and what is left after a second, mm; time until the
    excursion stays within a tenth of its peak, s; peak without the loop, mm.
    """

    peak_mm: float
    left_mm: float
    recovery_s: float
    without_loop_mm: float
    lift_peak_mm: float


@dataclass(frozen=True)
class Tremor:
    """Noise of 4 .. 12 Hz at the finger: rms of the position with the loop and (by the model) without, mm."""

    rms_mm: float
    without_loop_mm: float
    rejection_db: float
    expected_db: float


@dataclass(frozen=True, eq=False)
class DisturbanceReport:
    """Disturbances found on one channel. unit: mm for a displacement sensor, mm/s and mm/s^2 for the others."""

    channel: str
    rejection: Rejection
    press: Press
    tremor: Tremor
    unit: str = "mm"

    __repr__ = brief


def disturbance(
    rig: Rig,
    controller: Controller,
    channel: str,
    frequency_hz: ArrayLike,
    rng: np.random.Generator,
    *,
    excursion_mm: float = EXCURSION_MM,
    mains_hz: float | None = MAINS_HZ,
) -> DisturbanceReport:
    """Disturb `channel` at its finger port while the controller holds it at rest, and compare with S.

    frequency_hz (m,): of the rejection. excursion_mm: what each force would move without the loop, as far as half the
    command range allows. Raises BadInput for an unknown channel, and for a real display, which has no finger port.
    """
    described = controller.display.channel(channel)
    if excursion_mm <= 0.0:
        raise BadInput(f"excursion {excursion_mm:g} mm", "a positive number")
    check_frequencies(rig, frequency_hz)
    plant = discretise(described.plant, rig.rate_hz, "zoh")
    feedback = ChannelPrediction.of(controller, channel).loop.feedback

    def sensitivity(hertz: FloatArray) -> NDArray[np.complex128]:
        return np.ones(hertz.shape, dtype=np.complex128) if feedback is None else feedback.sensitivity(hertz)

    bench = _Bench(rig, described, plant, excursion_mm, sensitivity)
    rejection = bench.rejection(np.unique(off_mains(frequency_hz, mains_hz)), mains_hz)
    press = bench.press()
    tremor = bench.tremor(rng)
    rig.rest()
    unit = ("mm", "mm/s", "mm/s^2")[DERIVATIVES[described.quantity]]
    return DisturbanceReport(channel, rejection, press, tremor, unit)


class _Bench:
    """One channel at rest under its controller, with a finger port to press."""

    def __init__(
        self,
        rig: Rig,
        channel: Channel,
        plant: SampledSystem,
        excursion_mm: float,
        sensitivity: Callable[[FloatArray], NDArray[np.complex128]],
    ) -> None:
        self._rig, self._channel, self._plant, self._sensitivity = rig, channel, plant, sensitivity
        self._port, self._column = rig.finger(channel.name), rig.channels.index(channel.name)
        self._excursion_v = excursion_mm * channel.sensor_gain_v_per_mm
        self._largest_v = 0.5 * channel.converter.range_v
        self._play(np.zeros(round(2.0 * rig.rate_hz)))

    def _play(self, force: FloatArray) -> FloatArray:
        """Press with a force (n,) at rest, and return the position, volts."""
        self._port.press(force)
        return self._rig.play(np.zeros((force.size, len(self._rig.channels)))).position_v[:, self._column]

    def rejection(self, frequency_hz: FloatArray, mains_hz: float | None) -> Rejection:
        """Press with one sinusoidal force after the other and return the rejection of each."""
        rows = [self._rejection_at(float(hertz), mains_hz) for hertz in frequency_hz]
        measured, confidence, force, saturated = (np.array(column) for column in zip(*rows, strict=True))
        expected = db(self._sensitivity(frequency_hz))
        return Rejection(frequency_hz, measured, confidence, expected, force, saturated.astype(bool))

    def _rejection_at(self, hertz: float, mains_hz: float | None) -> tuple[float, float, float, bool]:
        rate = self._rig.rate_hz
        through = self._plant.response(np.array([hertz]))[0]
        force_v = min(self._excursion_v / abs(through), self._largest_v)
        tone = Tone(hertz, force_v, rate, mains_hz)
        found = measure_lines(self._pressed, rate, [self._column], tone, _REJECTION)
        measured_db = float(db(found.amplitude[0, 0] / (through * force_v)))
        return measured_db, float(found.confidence_db[0, 0]), force_v, bool(found.saturated[0, 0])

    def _pressed(self, waves: Iterable[FloatArray]) -> Iterator[Trace]:
        """Press with waves of force, one after another without a gap, at rest."""

        def rows() -> Iterator[FloatArray]:
            for wave in waves:
                self._port.press(wave)
                yield np.zeros((wave.size, len(self._rig.channels)))

        return self._rig.stream(rows())

    def press(self) -> Press:
        """Press for a second within 20 ms, lift, and watch another second."""
        rate, gain = self._rig.rate_hz, self._channel.sensor_gain_v_per_mm
        force_v = min(self._excursion_v / abs(self._plant.response(np.array([0.4]))[0]), self._largest_v)
        second = round(rate)
        force = np.zeros(2 * second)
        force[:second] = force_v * np.minimum(1.0, np.arange(second) / (0.02 * rate))
        self._play(np.zeros(second))  # the last force of the rejection ended at once
        before = self._play(np.zeros(second // 2))
        position = self._play(force)
        moved = (position - before.mean()) / gain
        # a sixtieth of a second takes out hum of 60 Hz and most noise
        width = max(1, round(rate / 60.0))
        smooth = np.convolve(moved, np.ones(width) / width, mode="same")
        pressed, lifted = smooth[:second], smooth[second:]
        peak = int(np.argmax(np.abs(pressed)))
        outside = np.flatnonzero(np.abs(pressed[peak:]) > 0.1 * abs(pressed[peak]))
        recovery = (peak + (outside[-1] + 1 if outside.size else 0)) / rate
        free = self._free(force) / gain
        self._play(np.zeros(second))
        return Press(
            peak_mm=float(abs(pressed[peak])),
            left_mm=abs(float(np.mean(moved[second - second // 20 : second]))),
            recovery_s=float(recovery),
            without_loop_mm=float(np.max(np.abs(free))),
            lift_peak_mm=float(np.max(np.abs(lifted))),
        )

    def tremor(self, rng: np.random.Generator) -> Tremor:
        """Press with eight seconds of noise of 4 .. 12 Hz, made of lines so that it can be found again."""
        rate, gain = self._rig.rate_hz, self._channel.sensor_gain_v_per_mm
        lines = np.arange(TREMOR_HZ[0], TREMOR_HZ[1] + 0.125, 0.25)
        through = self._plant.response(lines)
        size = np.sqrt(2.0 / lines.size) * self._excursion_v / np.abs(through)
        size *= min(1.0, self._largest_v / np.sum(size))
        phase = rng.uniform(0.0, 2.0 * np.pi, lines.size)
        count = round(10.0 * rate)
        angle = 2.0 * np.pi * np.outer(np.arange(count), lines) / rate + phase
        force = np.cos(angle) @ size
        position = self._play(force * ramps(count, rate, 0.2))
        kept = slice(round(1.5 * rate), round(9.5 * rate))
        measured = lock_in(position[kept], lines, rate, start=kept.start)
        free = through * size
        expected = free * self._sensitivity(lines)
        rms, rms_free, rms_expected = (float(np.sqrt(0.5 * np.sum(np.abs(x) ** 2))) for x in (measured, free, expected))
        return Tremor(rms / gain, rms_free / gain, float(db(rms / rms_free)), float(db(rms_expected / rms_free)))

    def _free(self, force: FloatArray) -> FloatArray:
        """Return the motion that the force would cause without the loop, volts of y, (n,), by the model."""
        count = 4 * force.size
        spectrum = np.fft.rfft(force, count)
        frequency = np.fft.rfftfreq(count, 1.0 / self._rig.rate_hz)
        frequency[0] = 0.25 * frequency[1]
        return np.asarray(np.fft.irfft(spectrum * self._plant.response(frequency), count)[: force.size])

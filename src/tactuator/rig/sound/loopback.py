"""One output of a card, and perhaps an input that a wire joins to it: delay, and volts at full scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.csv_tables import resolve_curve
from tactuator.model.description import Channel, Converter, Display, Threshold
from tactuator.model.requirements import FeedbackRequirements, SoundCard, Wires
from tactuator.rig.rig import Rig
from tactuator.signals.systems import ContinuousSystem

LEAST_RATE_HZ = 1000.0
BURSTS, BURST_S = 5, 1.0
_SURE = 0.5
"""Least correlation of what comes back with what was put out."""
_UNHEARD = (
    "what was put out does not come back at the input",
    "a wire from that output to that input, with its gain turned up",
)


def wire_display(rate_hz: float, output: int, input_number: int) -> Display:
    """Return a display that is a wire from an output to an input (0: none), whose volts are shares of full scale.

    Raises BadInput for a rate below LEAST_RATE_HZ.
    """
    if not (np.isfinite(rate_hz) and rate_hz >= LEAST_RATE_HZ):
        raise BadInput(f"a rate of {rate_hz:g} Hz", f"{LEAST_RATE_HZ:g} Hz or more, as the card has it")
    sound = SoundCard((Wires(output, input_number, 1.0, 1.0),), lead_s=0.5)
    threshold = Threshold(resolve_curve("bolanowski-1988"), (1.0, min(300.0, rate_hz / 4.0)))
    channel = Channel(
        name="wire",
        finger="wire",
        sensor_gain_v_per_mm=1.0,
        travel_mm=1.0,
        plant=ContinuousSystem(np.empty(0), np.empty(0), 1.0),
        threshold=threshold,
        converter=Converter(range_v=1.0),
        feedback=FeedbackRequirements(structure="none"),
    )
    return Display("wire", rate_hz, 0, (channel,), sound=sound)


@dataclass(frozen=True)
class Delay:
    """Delay through a wire. samples: from output to input; spread: between bursts and within them, samples; gain: what
    comes back for 1.
    """

    samples: int
    spread: int
    gain: float


def measure_delay(rig: Rig, level: float, rng: np.random.Generator) -> Delay:
    """Return the delay through a wire on the rig of a `wire_display`, by bursts of noise at a share of full scale.

    Raises BadInput for a level out of range, and where nothing of the bursts comes back.
    """
    if not 0.0 < level <= 0.9:
        raise BadInput(f"level {level:g}", "above 0, at most 0.9 of full scale")
    count = round(BURST_S * rig.rate_hz)
    delays: list[int] = []
    gains: list[float] = []
    for _ in range(BURSTS):
        burst = np.zeros((2 * count, 1))
        burst[:count, 0] = level * rng.uniform(-1.0, 1.0, count)
        trace = rig.drive(burst)
        asked, heard = trace.command_v[:, 0], trace.position_v[:, 0]
        for part in (slice(0, count // 2), slice(count // 2, count)):
            delay, gain = _delay(asked, heard, part)
            delays.append(delay)
            gains.append(gain)
    return Delay(round(float(np.median(delays))), max(delays) - min(delays), float(np.mean(gains)))


def _delay(asked: FloatArray, heard: FloatArray, part: slice) -> tuple[int, float]:
    """Return by how much `heard` comes after a part of `asked`, and the gain there."""
    burst = np.zeros(asked.size)
    burst[part] = asked[part]
    size = 2 * asked.size
    cross = np.fft.irfft(np.conj(np.fft.rfft(burst, size)) * np.fft.rfft(heard, size), size)[: asked.size // 2]
    delay = int(np.argmax(np.abs(cross)))
    there = heard[part.start + delay : part.stop + delay]
    power = float(np.sum(burst[part] ** 2))
    sure = abs(float(cross[delay])) / np.sqrt(power * float(np.sum(there**2)) + 1e-300)
    if sure < _SURE:
        raise BadInput(*_UNHEARD)
    return delay, float(cross[delay]) / power


def tone(rig: Rig, frequency_hz: float, level: float, duration_s: float) -> float:
    """Play a tone at a share of full scale and return its peak at the input, as a share of full scale; 0 without one.

    Raises BadInput for a level or frequency out of range, and where the tone does not come back at an input.
    """
    if not (0.0 < level <= 0.9 and 1.0 <= frequency_hz <= 0.4 * rig.rate_hz and 1.0 <= duration_s <= 600.0):
        raise BadInput(
            f"a tone of {frequency_hz:g} Hz at {level:g} for {duration_s:g} s",
            f"1 to {0.4 * rig.rate_hz:g} Hz, above 0 to 0.9 of full scale, 1 to 600 s",
        )
    time = np.arange(round(duration_s * rig.rate_hz)) / rig.rate_hz
    wave = level * np.sin(2.0 * np.pi * frequency_hz * time)
    heard = rig.drive(wave[:, None]).position_v[time.size // 2 :, 0]
    turn = np.exp(-2j * np.pi * frequency_hz * time[time.size // 2 :])
    peak = float(2.0 * np.abs(np.mean(heard * turn)))
    if rig.without_sensor:
        return 0.0
    if peak <= _SURE * np.sqrt(2.0 * float(np.mean(heard**2))):
        raise BadInput(*_UNHEARD)
    return peak


def full_scale_v(reading_v: float, level: float) -> float:
    """Return the volts at full scale for a reading, V rms, of a tone at a share of full scale; BadInput for a reading
    that is not positive.
    """
    if not (np.isfinite(reading_v) and reading_v > 0.0):
        raise BadInput(f"a reading of {reading_v:g} V rms", "a positive number")
    return float(np.sqrt(2.0) * reading_v / level)

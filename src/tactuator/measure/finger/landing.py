"""Felt level over time while a finger lands and is lifted, on the simulated display, adaptive and fixed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.decibels import db, from_db

LANDS_S, LIFTED_S, _ENDS_S = 1.0, 2.0, 3.0
_WINDOW_S, _STEP_S = 0.1, 0.005
_TONES_HZ = (3.0, 9.0, 27.0, 85.0, 250.0)


@dataclass(frozen=True, eq=False)
class Landing:
    """Change of the felt level against the same run free, dB, at the middles time_s (n,) of windows of 0.1 s."""

    channel: str
    load: str
    time_s: FloatArray
    adaptive_db: FloatArray
    fixed_db: FloatArray


def landing(controller: Controller, channel: str, seed: int = 0, level_db_sl: float = 30.0) -> Landing:
    """Play five tones (those inside the band) at `level_db_sl` each while the channel's first load lands after 1 s and
    is lifted after 2 s; return what is felt of it with the channel's feed-forward, and without.

    Felt is the displacement through the threshold's curve over its band.
    """
    shown = controller.display.channel(channel)
    rate, load = controller.rate_hz, shown.loads[0].name
    low, high = shown.threshold.band_hz
    time = np.arange(round(_ENDS_S * rate)) / rate
    tones = [hertz for hertz in _TONES_HZ if low <= hertz <= high]
    asked = float(from_db(level_db_sl)) * np.sum(
        [np.sin(2.0 * np.pi * hertz * time + hertz) for hertz in tones], axis=0
    )
    fixed = replace(controller, channels=tuple(replace(own, feed_forward=None) for own in controller.channels))
    runs = [_felt(made, shown, asked, on, seed) for made, on in ((fixed, None), (fixed, load), (controller, load))]
    free, still, learnt = runs
    middle = np.asarray(np.arange(free.size) * _STEP_S + 0.5 * _WINDOW_S, dtype=np.float64)
    return Landing(channel, load, middle, db(learnt / free), db(still / free))


def _felt(controller: Controller, channel: Channel, asked: FloatArray, load: str | None, seed: int) -> FloatArray:
    """Return the felt rms, threshold units, in windows of 0.1 s every 5 ms, (n,)."""
    rate = controller.rate_hz
    moved: list[FloatArray] = []
    with SimulatedRig(controller.display, seed) as rig:
        finger = rig.finger(channel.name)
        finger.attach(moved.append)
        rig.load(controller)
        reference = np.zeros((asked.size, len(rig.channels)))
        reference[:, rig.channels.index(channel.name)] = asked
        cuts = [0, round(LANDS_S * rate), round(LIFTED_S * rate), asked.size]
        for on, start, stop in zip((None, load, None), cuts, cuts[1:], strict=False):
            finger.touch(on)
            rig.play(reference[start:stop])
    volts = channel.sensor_gain_v_per_mm * np.concatenate(moved)
    frequency = np.fft.rfftfreq(volts.size, 1.0 / rate)
    low, high = channel.threshold.band_hz
    inside = (frequency >= low) & (frequency <= high)
    weight = np.zeros(frequency.size)
    weight[inside] = 1.0 / channel.threshold_voltage(frequency[inside])
    sums = np.concatenate([[0.0], np.cumsum(np.fft.irfft(np.fft.rfft(volts) * weight, volts.size) ** 2)])
    window, step = round(_WINDOW_S * rate), max(1, round(_STEP_S * rate))
    return np.asarray(np.sqrt((sums[window:] - sums[:-window]) / window)[::step])

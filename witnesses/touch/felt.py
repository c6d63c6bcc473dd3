"""The display that the witnesses judge, its controllers, and the felt level: of a tone, and over time."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.io.display import read_display
from tactuator.model.controller import ChannelController
from tactuator.model.description import Channel, Display
from tactuator.model.requirements import Touch
from tactuator.synthesis.design import design_controller

WINDOW_S = 0.1
LEAST_DB_SL = 19.0
"""A window counts where the free display is felt at 20 dB SL, less a decibel: below it nothing is promised."""
QUIET = 0.1
"""What is quieter is told, not judged, down to this share of the greatest."""
FULL_V = 9.999


@cache
def example() -> Display:
    """Return the example display, adaptive."""
    with as_file(files("tactuator.io") / "examples" / "display.toml") as path:
        return replace(read_display(path), touch=Touch(adaptive=True))


@cache
def designed() -> tuple[ChannelController, ...]:
    """Return the adaptive controller of each channel, as designed."""
    return design_controller(example()).channels


def adaptive(place: int, mass_fed: float | None = None) -> ChannelController:
    """Return a channel's adaptive controller; mass_fed: share of the mass fed forward, in place of the designed one."""
    own = designed()[place]
    assert own.feed_forward is not None
    return own if mass_fed is None else replace(own, feed_forward=replace(own.feed_forward, mass_fed=mass_fed))


def judged(place: int, wrong: bool) -> ChannelController:
    """Return the adaptive controller; `wrong`: one that feeds forward three times the mass that it has learnt."""
    return adaptive(place, 3.0 if wrong else None)


def fixed(place: int) -> ChannelController:
    """Return the same controller with nothing fed forward."""
    return replace(designed()[place], feed_forward=None)


def nominal(place: int) -> tuple[float, float, float]:
    """Return mass, damping and stiffness of the finger that the channel was designed for."""
    load = example().channels[place].loads[0]
    return load.mass, load.damping, load.stiffness


def times(seconds: float) -> FloatArray:
    """Return the instants of so many seconds."""
    return np.asarray(np.arange(round(seconds * example().rate_hz)) / example().rate_hz)


def tone_length_s(frequency_hz: float) -> float:
    """Return the time over which a tone's level is taken: whole periods, one second at least."""
    return float(np.ceil(max(1.0, 2.0 / frequency_hz) * frequency_hz) / frequency_hz)


def tone_error_db(channel: Channel, y_v: FloatArray, frequency_hz: float, level_db_sl: float) -> float:
    """Return felt level less asked level of a tone, from the last whole periods of y (n,) by least squares."""
    rate_hz = example().rate_hz
    last = y_v[-round(tone_length_s(frequency_hz) * rate_hz) :]
    phase = 2.0 * np.pi * frequency_hz * np.arange(last.size) / rate_hz
    basis = np.stack([np.cos(phase), np.sin(phase), np.ones(last.size)], axis=1)
    peak_v = np.hypot(*np.linalg.lstsq(basis, last, rcond=None)[0][:2])
    threshold_v = channel.threshold_voltage(np.array([frequency_hz]))[0]
    return float(20.0 * np.log10(peak_v / threshold_v) - level_db_sl)


def felt_over_time(channel: Channel, y_v: FloatArray, window_s: float = WINDOW_S) -> FloatArray:
    """Return the rms of y (n,) through the threshold's curve, threshold units, in windows that begin in each sample."""
    rate_hz = example().rate_hz
    frequency_hz = np.fft.rfftfreq(y_v.size, 1.0 / rate_hz)
    low, high = channel.threshold.band_hz
    inside = (frequency_hz >= low) & (frequency_hz <= high)
    by = np.zeros(frequency_hz.size)
    by[inside] = 1.0 / channel.threshold_voltage(frequency_hz[inside])
    square = np.fft.irfft(np.fft.rfft(y_v) * by, y_v.size) ** 2
    count = round(window_s * rate_hz)
    sums = np.concatenate([[0.0], np.cumsum(square)])
    return np.asarray(np.sqrt(np.maximum(sums[count:] - sums[:-count], 0.0) / count))


def is_sound(free: FloatArray) -> NDArray[np.bool_]:
    """Tell in which windows there is sound to be felt, of the free display's rms in each, threshold units."""
    return np.asarray(free * np.sqrt(2.0) > 10.0 ** (LEAST_DB_SL / 20.0))


def arguments(about: str | None, count: int, count_is: str, **switches: str) -> argparse.Namespace:
    """Return the options of a witness: --seed, --count, and switches that break what is judged."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=count, help=count_is)
    parser.add_argument("--speech", type=Path, help="folder of recordings, for what plays speech")
    for name, words in switches.items():
        parser.add_argument(f"--{name}", action="store_true", help=words)
    return parser.parse_args()


def verdict(what: str, found: float, most: float, unit: str = "dB") -> bool:
    """Print a figure beside its limit; tell whether it is kept."""
    kept = bool(found <= most)
    print(f"{what:<78}{found:9.3f} {unit:<3}{'at most':>9}{most:7.2f}  {'kept' if kept else 'BROKEN'}", flush=True)
    return kept

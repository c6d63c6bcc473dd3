"""The paper's four objectives (its section 2), judged for a controller from its own sections and a display's figures.

What a finger feels of sensor noise and hum n is -T n, of a disturbance of the command P S d: never the sensor's own
spectrum. A band's noise is judged by its rms times the root of two, the peak of the sinusoid of the same power.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.display.controller import ChannelController, Controller
from tactuator.display.description import Channel, Display
from tactuator.display.requirements import Objectives
from tactuator.loop.feedback import TwoDegreeLoop
from tactuator.loop.margins import margins
from tactuator.signals.bands import third_octave_bands
from tactuator.signals.decibels import db
from tactuator.synthesis.family import UNLOADED, Member, plant_family

_NAMES = {
    "i": "|H| follows the threshold curve over the band, without load",
    "ii": "every mains line is felt below threshold",
    "iii": "noise is felt below threshold in every third octave, and no resonance stands out",
    "iv": "a finger's load does not change |H| at low frequencies",
}
_POINTS = 600


@dataclass(frozen=True)
class Objective:
    """One objective: its number, words, whether it is met, and its figures by channel and load."""

    number: str
    words: str
    met: bool
    figures: dict[str, dict[str, dict[str, Any]]]


@dataclass(frozen=True)
class Verdict:
    """All four objectives; `met` if each is."""

    objectives: tuple[Objective, ...]

    @property
    def met(self) -> bool:
        """Return whether every objective is met."""
        return all(objective.met for objective in self.objectives)

    def document(self) -> dict[str, Any]:
        """Return plain tables: what `check --json` prints."""
        return {
            "met": self.met,
            "objectives": {
                one.number: {"met": one.met, "asks": one.words, "channels": one.figures} for one in self.objectives
            },
        }


def judge(controller: Controller, display: Display | None = None) -> Verdict:
    """Return the verdict on `controller` for `display` (None: the one it was designed for).

    A loop that is unstable under some load fails every objective, and its figures say so. Raises BadInput where the
    display's channels, rate or delay are not the controller's.
    """
    shown = controller.display if display is None else display
    controller.require_runs(shown)
    figures: dict[str, dict[str, dict[str, dict[str, Any]]]] = {number: {} for number in _NAMES}
    for channel in shown.channels:
        judged = _judge_channel(controller.channel(channel.name), channel, shown)
        for number in _NAMES:
            figures[number][channel.name] = judged[number]
    return Verdict(
        tuple(
            Objective(number, words, all(_all_met(by_load) for by_load in figures[number].values()), figures[number])
            for number, words in _NAMES.items()
        )
    )


def _all_met(by_load: dict[str, dict[str, Any]]) -> bool:
    return all(figures["met"] for figures in by_load.values())


def _judge_channel(own: ChannelController, channel: Channel, display: Display) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the figures of one channel, by objective and load."""
    family = plant_family(channel, display.rate_hz, display.delay_samples)
    prefilter, feedback = own.prefilter(display.rate_hz), own.feedback(display.rate_hz)
    loops = {member.name: TwoDegreeLoop(prefilter, feedback, member.sampled) for member in family}
    result: dict[str, dict[str, dict[str, Any]]] = {number: {} for number in _NAMES}
    nominal = loops[UNLOADED]
    for member in family:
        loop = loops[member.name]
        if loop.feedback is not None and not loop.feedback.is_stable:
            for number in _NAMES:
                result[number][member.name] = {"met": False, "stable": False}
            continue
        result["i"][member.name] = _flatness(channel, loop, member, display.objectives)
        result["ii"][member.name] = _mains(channel, loop, display.objectives)
        result["iii"][member.name] = _noise(channel, loop, display)
        if member.load != UNLOADED and _is_stable(nominal):
            result["iv"][member.name] = _load(channel, loop, nominal, display.objectives)
    return result


def _is_stable(loop: TwoDegreeLoop) -> bool:
    return loop.feedback is None or loop.feedback.is_stable


def _band(channel: Channel) -> FloatArray:
    low, high = channel.threshold.band_hz
    own = channel.threshold.curve.frequency_hz
    return np.unique(np.append(np.geomspace(low, high, _POINTS), own[(own >= low) & (own <= high)]))


def _flatness(channel: Channel, loop: TwoDegreeLoop, member: Member, asked: Objectives) -> dict[str, Any]:
    """Judge objective i; under a load, where feedback cannot help above its bandwidth, the figures are told, not
    judged.
    """
    frequency = _band(channel)
    error = db(np.abs(loop.position_response(frequency)) / channel.threshold_voltage(frequency))
    worst = int(np.argmax(np.abs(error)))
    judged = member.load == UNLOADED
    return {
        "met": bool(not judged or abs(error[worst]) <= asked.flatness_db),
        "judged": judged,
        "max_error_db": float(abs(error[worst])),
        "worst_hz": float(frequency[worst]),
        "allowed_db": asked.flatness_db,
    }


def felt_db_sl(channel: Channel, peak_volts: FloatArray, frequency_hz: FloatArray) -> FloatArray:
    """Return the sensation level of a motion that is `peak_volts` at an ideal sensor, at `frequency_hz`;
    shapes alike.
    """
    return db(peak_volts / channel.threshold_voltage(frequency_hz))


def _mains(channel: Channel, loop: TwoDegreeLoop, asked: Objectives) -> dict[str, Any]:
    lines = np.array(channel.environment.hum_hz)
    hum = np.array(channel.environment.hum_v_peak)
    through = np.zeros(lines.size) if loop.feedback is None else np.abs(loop.feedback.complementary(lines))
    level = felt_db_sl(channel, through * hum, lines)
    return {
        "met": bool(np.all(level <= asked.mains_max_db_sl)),
        "felt_db_sl": {f"{f:g}": _finite(v) for f, v in zip(lines, level, strict=True)},
        "allowed_db_sl": asked.mains_max_db_sl,
    }


def _noise(channel: Channel, loop: TwoDegreeLoop, display: Display) -> dict[str, Any]:
    low, high = channel.threshold.band_hz
    bands = third_octave_bands(low, high)
    centres = np.array([band.centre_hz for band in bands])
    edges = np.array([[band.low_hz, band.high_hz] for band in bands])
    peak = np.sqrt(2.0) * felt_noise_rms_v(channel, loop, display.rate_hz, edges)
    level = felt_db_sl(channel, peak, np.clip(centres, low, high))
    worst = int(np.argmax(level))
    resonance = None if loop.feedback is None else margins(loop.feedback).complementary_peak
    allowed = display.objectives
    return {
        "met": bool(level[worst] <= allowed.noise_max_db_sl)
        and (resonance is None or resonance <= allowed.resonance_peak),
        "worst_band_db_sl": float(level[worst]),
        "worst_band_hz": float(centres[worst]),
        "resonance_peak": resonance,
        "allowed_db_sl": allowed.noise_max_db_sl,
        "allowed_peak": allowed.resonance_peak,
    }


def felt_noise_rms_v(channel: Channel, loop: TwoDegreeLoop, rate_hz: float, edges_hz: FloatArray) -> FloatArray:
    """Return the rms of the finger's motion (volts at an ideal sensor) in bands of edges (n, 2): sensor noise and the
    A/D's steps through T, the D/A's steps through P S. Steps make white noise of step^2 / 12.
    """
    step = channel.converter.step_v**2 / 12.0
    nodes, weights = np.polynomial.legendre.leggauss(12)
    half = 0.5 * np.diff(edges_hz, axis=1)
    frequency = edges_hz[:, :1] + half * (1.0 + nodes)
    if loop.feedback is None:
        power = np.abs(loop.plant.response(frequency)) ** 2 * step
    else:
        sensed = channel.environment.noise_v_rms**2 + step
        power = np.abs(loop.feedback.complementary(frequency)) ** 2 * sensed
        power = power + np.abs(loop.feedback.load_sensitivity(frequency)) ** 2 * step
    return np.asarray(np.sqrt(np.sum(power * half * weights, axis=1) / (0.5 * rate_hz)))


def _load(channel: Channel, loop: TwoDegreeLoop, nominal: TwoDegreeLoop, asked: Objectives) -> dict[str, Any]:
    frequency = _band(channel)
    change = db(np.abs(loop.position_response(frequency)) / np.abs(nominal.position_response(frequency)))
    low = np.abs(change[frequency <= asked.load_band_hz])
    worst = int(np.argmax(np.abs(change)))
    greatest = float(np.max(low, initial=0.0))
    return {
        "met": greatest <= asked.load_max_db,
        "max_change_db": greatest,
        "up_to_hz": asked.load_band_hz,
        "worst_change_db": float(change[worst]),
        "worst_hz": float(frequency[worst]),
        "allowed_db": asked.load_max_db,
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None

"""A look-ahead limiter that keeps a display's limits by construction: nothing is let out that was not checked.

The limits of a channel are comfort, travel and command, untouched and under every load. Comfort, 55 dB SL at each
frequency, is kept in two ways. No sample of the felt signal (the displacement weighted by the inverse threshold curve
with zero phase) exceeds the amplitude of 55 dB SL. And no sample of the reference exceeds pi/4 of it, less the
response's own error: of a signal that stays within +/- A, no sinusoidal component found with any positive window
exceeds 4 A / pi (that of a square wave), so no component exceeds 55 dB SL, whatever the waveform.

The stream is taken in stretches of 12 s with 2 s of look-ahead. For every finger the responses of its limits predict,
from the reference as it would go out and from what went out before, the felt signal, the displacement and the command.
Where one would pass its limit, the reduction there is raised by what is missing, over a neighbourhood that doubles
with every round (so that a slow response's cause is reached as well), and all is predicted anew. A stretch that reaches
no limit passes untouched, to the bit. The reduction is the smallest smooth one, in dB, that is nowhere less than what
is needed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import scipy

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.measure.error import ChannelPrediction
from tactuator.model.controller import Controller
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.signals.decibels import from_db
from tactuator.signals.spectra import SlidingWindow

SAFETY_DB = 0.25
"""Kept from every limit for what the linear prediction leaves out: friction, hum, noise, word lengths, memory."""

QUIET_ABOVE_HZ = 320.0
"""Every coding is silent above; see the codings."""

BINDING_SHARE = 0.8
"""A limit that the greatest allowed reference reaches to no more than this share is not looked at again."""

STRETCH_S, AHEAD_S, MEMORY_S = 12.0, 2.0, 4.0


@dataclass(frozen=True, eq=False)
class Constraint:
    """A limit at every sample: |response applied to the reference| <= limit.

    kind: comfort, travel or command. response: at the bins of a transform of `size` samples.
    """

    kind: str
    response: ComplexArray
    limit: float


@dataclass(frozen=True, eq=False)
class ChannelLimits:
    """The constraints of one channel, and the greatest |r| that comfort allows."""

    finger: str
    peak: float
    constraints: tuple[Constraint, ...]


@lru_cache(maxsize=16)
def channel_limits(controller: Controller, name: str, size: int) -> ChannelLimits:
    """Return the limits of a channel for transforms of `size` samples at the controller's rate."""
    peak, asked = all_limits(controller, name, size)
    quiet = _quiet(scipy.fft.rfftfreq(size, 1.0 / controller.rate_hz))
    norms = np.abs(scipy.fft.irfft(np.stack([each.response for each in asked]) * quiet, size)).sum(axis=1)
    stated = zip(asked, norms.tolist(), strict=True)
    binding = (each for each, norm in stated if BINDING_SHARE * each.limit / norm < peak)
    return ChannelLimits(name, peak, tuple(binding))


def all_limits(controller: Controller, name: str, size: int) -> tuple[float, list[Constraint]]:
    """Return the greatest |r| that comfort allows on a channel, and every constraint of it, untouched and touched."""
    channel, designed = controller.display.channel(name), controller.channel(name).limits
    comfort = float(from_db(min(designed.comfort_db_sl, COMFORT_DB_SL) - SAFETY_DB))
    keep = float(from_db(-SAFETY_DB))
    command_v = keep * min(designed.command_v, channel.converter.range_v) - abs(channel.converter.offset_v)
    frequency = scipy.fft.rfftfreq(size, 1.0 / controller.rate_hz)
    heard, raised = frequency <= QUIET_ABOVE_HZ, _raised(controller, name, frequency)
    asked, gain, weight = [], 1.0, channel.threshold.curve.displacement_mm(frequency)
    for load in (None, *(load.name for load in channel.loads)):
        prediction = ChannelPrediction.of(controller, name, load)
        displacement = raised * prediction.displacement(frequency)
        felt = displacement / weight
        gain = max(gain, float(np.abs(felt[heard]).max()))
        asked += [
            Constraint("comfort", felt, comfort),
            Constraint("travel", displacement, keep * channel.travel_mm),
            Constraint("command", raised * prediction.command(frequency), command_v),
        ]
    return 0.25 * np.pi * comfort / gain, asked


def _raised(controller: Controller, name: str, frequency_hz: FloatArray) -> FloatArray | float:
    """Return the most that the reference is raised by at any of its levels, where it is reshaped by its strength."""
    strength = controller.channel(name).strength
    if strength is None:
        return 1.0
    levels = np.arange(0.0, COMFORT_DB_SL, 3.0)
    gains = [np.abs(strength.response(level, frequency_hz, controller.rate_hz)) for level in levels]
    return np.asarray(np.maximum(1.0, np.max(gains, axis=0)))


def _quiet(frequency: FloatArray) -> FloatArray:
    """Return a low-pass that is 1 up to 320 Hz: a quiet reference shows no difference."""
    fall = np.clip((2.5 * QUIET_ABOVE_HZ - frequency) / (1.5 * QUIET_ABOVE_HZ), 0.0, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * fall))


ATTACK_DB_PER_MS = 0.25
RELEASE_DB_PER_MS = 0.05
"""Slopes at which a reduction comes and goes; both are well below the 0.5 dB/ms beyond which a gain is felt to jump."""


def reduction_envelope(need_db: FloatArray, start_db: float | None, rate_hz: float) -> FloatArray:
    """Return the lower envelope of straight flanks: max over s of need(s) less the slope times the distance to s.

    need_db: shape (n,), zero or more. start_db: the reduction one sample earlier, None where nothing went before. A
    flank rises towards a need at the attack's slope and falls after it at the release's: no other reduction with these
    slopes is smaller anywhere.
    """
    index = np.arange(len(need_db))
    attack, release = ATTACK_DB_PER_MS * 1e3 / rate_hz, RELEASE_DB_PER_MS * 1e3 / rate_hz
    after = np.maximum.accumulate(need_db + release * index) - release * index
    if start_db is not None:
        after = np.maximum(after, start_db - release * (index + 1.0))
    before = np.maximum.accumulate((after - attack * index)[::-1])[::-1] + attack * index
    reduction = np.maximum(before, 0.0)
    if start_db is None:
        return np.asarray(reduction)
    return np.asarray(np.minimum(reduction, start_db + attack * (index + 1.0)))


EDGE_S = 0.25
"""At the end of the look-ahead, where what follows is not known yet, the prediction is faded out and not judged."""
FIRST_REACH_S = 0.0025
OVERSHOOT_DB = 0.02
MOST_ROUNDS = 60


@dataclass
class FingerLimiting:
    """Limiting of one finger. reduced_s: time with a reduction; reasons: seconds at which each limit asked it."""

    finger: str
    max_reduction_db: float = 0.0
    max_slope_db_per_ms: float = 0.0
    reduced_s: float = 0.0
    reasons: dict[str, float] = field(default_factory=lambda: {"comfort": 0.0, "travel": 0.0, "command": 0.0})


@dataclass
class _Finger:
    limits: ChannelLimits
    report: FingerLimiting
    carried_db: FloatArray
    start_db: float | None = None


class Limiter:
    """Limits a stream of blocks (n, channels) for a controller; `report` says what it did."""

    def __init__(self, controller: Controller) -> None:
        self._rate = controller.rate_hz
        self._stretch, ahead, self._memory = (round(s * self._rate) for s in (STRETCH_S, AHEAD_S, MEMORY_S))
        self._size = self._memory + self._stretch + ahead
        self._edge = round(EDGE_S * self._rate)
        self._fingers = [
            _Finger(channel_limits(controller, name, self._size), FingerLimiting(name), np.zeros(0))
            for name in (channel.name for channel in controller.display.channels)
        ]
        # what went out, the stretch and what is ahead
        self._window = SlidingWindow(len(self._fingers), self._size, self._stretch, self._memory)

    @property
    def report(self) -> tuple[FingerLimiting, ...]:
        """Return the limiting so far, finger by finger."""
        return tuple(finger.report for finger in self._fingers)

    def process(self, blocks: Iterable[FloatArray]) -> Iterator[FloatArray]:
        """Yield the blocks (n, channels), limited; as many samples in all."""
        for block in blocks:
            for _ in self._window.push(block):
                yield self._limit(self._stretch, last=False)
        for count in self._window.finish():
            yield self._limit(min(self._stretch, count), last=count <= self._stretch)

    def _limit(self, commit: int, last: bool) -> FloatArray:
        memory = self._memory
        for finger, signal in zip(self._fingers, self._window.rows, strict=True):
            reduction, limited = self._reduce(finger, signal, last)
            signal[memory : memory + commit] = limited[:commit]
            self._commit(finger, reduction, commit)
        return self._window.rows[:, memory : memory + commit].copy().T  # the window moves on

    def _reduce(self, finger: _Finger, signal: FloatArray, last: bool) -> tuple[FloatArray, FloatArray]:
        history, reference = signal[: self._memory], signal[self._memory :]
        need = np.zeros(len(reference))
        need[: len(finger.carried_db)] = finger.carried_db
        fade = np.ones(len(reference))
        if not last:
            fade[-self._edge :] = 0.5 + 0.5 * np.cos(np.pi * (np.arange(self._edge) + 0.5) / self._edge)
        reach = FIRST_REACH_S * self._rate
        for _ in range(MOST_ROUNDS):
            reduction = reduction_envelope(need, finger.start_db, self._rate)
            limited = reference * 10.0 ** (-reduction / 20.0)
            excess, reasons = self._excess(finger.limits, history, limited, fade)
            if not last:
                excess[-self._edge :] = 0.0
            if excess.max() <= 1.0:
                for kind, seconds in reasons.items() if reduction.any() else ():
                    finger.report.reasons[kind] += seconds
                return reduction, limited
            missing = np.where(excess > 1.0, 20.0 * np.log10(np.maximum(excess, 1.0)) + OVERSHOOT_DB, 0.0)
            wanted = np.where(missing > 0.0, reduction + missing, 0.0)
            width = min(2 * round(reach) + 1, 2 * len(reference) - 1)
            need = np.maximum(need, scipy.ndimage.maximum_filter1d(wanted, width, mode="constant"))
            reach *= 1.4
        raise AssertionError(f"limiter: no reduction found for {finger.limits.finger} in {MOST_ROUNDS} rounds")

    def _excess(
        self, limits: ChannelLimits, history: FloatArray, limited: FloatArray, fade: FloatArray
    ) -> tuple[FloatArray, dict[str, float]]:
        """Return the greatest share of any limit, sample by sample, and seconds within 0.5 dB of each kind of limit."""
        spectrum = scipy.fft.rfft(np.concatenate((history, limited * fade)), self._size)
        excess = np.abs(limited) / limits.peak
        near = {
            "comfort": excess > 0.944,
            "travel": np.zeros(len(limited), bool),
            "command": np.zeros(len(limited), bool),
        }
        for constraint in limits.constraints:
            predicted = scipy.fft.irfft(spectrum * constraint.response, self._size)[self._memory :]
            share = np.abs(predicted) / constraint.limit
            np.logical_or(near[constraint.kind], share > 0.944, out=near[constraint.kind])
            np.maximum(excess, share, out=excess)
        return excess, {kind: float(flags[: self._stretch].sum()) / self._rate for kind, flags in near.items()}

    def _commit(self, finger: _Finger, reduction: FloatArray, commit: int) -> None:
        report = finger.report
        if not reduction.any():
            finger.carried_db, finger.start_db = np.zeros(0), 0.0
            return
        steps = np.abs(
            np.diff(reduction[:commit], prepend=reduction[0] if finger.start_db is None else finger.start_db)
        )
        report.max_reduction_db = max(report.max_reduction_db, float(reduction[:commit].max()))
        report.max_slope_db_per_ms = max(report.max_slope_db_per_ms, float(steps.max()) * self._rate * 1e-3)
        report.reduced_s += np.count_nonzero(reduction[:commit]) / self._rate
        finger.carried_db = reduction[commit : len(reduction) - 2 * self._edge].copy()
        finger.start_db = float(reduction[commit - 1])

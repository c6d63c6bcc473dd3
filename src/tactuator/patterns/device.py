"""What a display can do, as other people's tools ask for it: greatest acceleration and level, rise, an ACF, a sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceHead
from tactuator.measure.error import ChannelPrediction
from tactuator.model.controller import Controller
from tactuator.model.plant import DERIVATIVES
from tactuator.patterns.android import LEAST_DB_SL, FrequencyProfile
from tactuator.patterns.rendering import PatternMap
from tactuator.perception.curve import AMPLITUDE_JND_DB, FREQUENCY_JND, curve, curve_names
from tactuator.signals.decibels import db, from_db
from tactuator.signals.record import Response
from tactuator.synthesis.design import headroom, headroom_grid_hz
from tactuator.table import brief

GRAVITY_M_S2 = 9.80665
_BELOW, _ABOVE = 0.8, 1.8
"""An emphasis lies between these multiples of the frequency at which a device is strongest, and lasts one and a half
periods or as long as the device rises (README of the ACF, Meta Haptics SDK)."""
_PERIODS = 1.5
_BURST_S = 2.0


@dataclass(frozen=True, eq=False)
class DeviceSheet:
    """The greatest that one channel of a display gives, untouched, one sinusoid at a time.

    frequency_hz: third octaves of the band, ascending; level_db_sl, displacement_mm, acceleration_g: peaks felt there;
    binding: the limit that stops each; all (n,). measured: whether the level is corrected by a measured response.
    band_hz: where 10 dB SL are reached. strongest_hz: at the greatest acceleration in it. rise_s: from 10 to 90 % of a
    tone there.
    """

    display: str
    channel: str
    curve: str
    frequency_hz: FloatArray
    level_db_sl: FloatArray
    displacement_mm: FloatArray
    acceleration_g: FloatArray
    binding: tuple[str, ...]
    measured: bool
    band_hz: tuple[float, float]
    strongest_hz: float
    rise_s: float

    __repr__ = brief

    @property
    def profile(self) -> FrequencyProfile:
        """Return Android's frequency profile of the channel."""
        return FrequencyProfile(self.frequency_hz, self.acceleration_g)

    @property
    def map(self) -> PatternMap:
        """Return how `.haptic` is rendered on the channel: tones over its band, taps about where it is strongest."""
        low, high = (float(np.clip(share * self.strongest_hz, *self.band_hz)) for share in (_BELOW, _ABOVE))
        first, last = (max(_PERIODS / hertz, self.rise_s) for hertz in (low, high))
        return PatternMap(
            band_hz=_rounded(*self.band_hz, 2),
            tap_hz=_rounded(low, high, 2),
            tap_s=_rounded(first, last, 5),
            tap_shape=("sine", "square"),
        )


def _rounded(first: float, last: float, digits: int) -> tuple[float, float]:
    return round(first, digits), round(last, digits)


def device_sheet(controller: Controller, channel: str, measured: Sequence[Response] = ()) -> DeviceSheet:
    """Return what a channel gives under its controller. measured: responses of the display, of which the untouched one
    of the channel takes the place of the model's felt error, as far as it reaches.

    Raises BadInput for a channel that is not there, or one that reaches 10 dB SL nowhere.
    """
    prediction = ChannelPrediction.of(controller, channel)
    described = controller.display.channel(channel)
    response = _untouched(measured, channel)
    grid = headroom_grid_hz(described)
    if response is not None:
        low, high = response.frequency_hz[[0, -1]]
        grid = np.array(sorted({low, high, *grid[(grid > low) & (grid < high)]}))
    room = headroom(described, prediction.loop, grid, controller.display.objectives.comfort_db_sl)
    threshold_mm = described.threshold.curve.displacement_mm(grid)
    error_db = db(prediction.felt(grid))
    if response is not None:
        speed = (2.0 * np.pi * response.frequency_hz) ** DERIVATIVES[described.quantity]
        moved_mm = response.magnitude_v / response.reference / described.sensor_gain_v_per_mm / speed
        felt_db = db(moved_mm / described.threshold.curve.displacement_mm(response.frequency_hz))
        error_db = np.interp(np.log(grid), np.log(response.frequency_hz), felt_db)
    level = room.level_db_sl + error_db
    displacement = from_db(level) * threshold_mm
    acceleration = (2.0 * np.pi * grid) ** 2 * displacement * 1e-3 / GRAVITY_M_S2
    reached = np.flatnonzero(level >= LEAST_DB_SL)
    if reached.size == 0:
        raise BadInput(f"{level.max():.1f} dB SL at most", f"{LEAST_DB_SL:g} dB SL somewhere", where=(channel,))
    strongest = float(grid[reached[np.argmax(acceleration[reached])]])
    return DeviceSheet(
        controller.display.name, channel, described.threshold.curve.name, grid, level, displacement, acceleration,
        room.binding, response is not None, (float(grid[reached[0]]), float(grid[reached[-1]])), strongest,
        _rise_s(prediction, strongest, controller.rate_hz),
    )  # fmt: skip


def _untouched(measured: Sequence[Response], channel: str) -> Response | None:
    fitting = [each for each in measured if each.channel == channel and each.load == "none"]
    if measured and not fitting:
        got = ", ".join(f"{each.channel} ({each.load})" for each in measured)
        raise BadInput(f"responses of {got}"[:120], f"an untouched one of {channel}")
    return max(fitting, key=lambda each: each.level_db_sl, default=None)


def _rise_s(prediction: ChannelPrediction, hertz: float, rate_hz: float) -> float:
    """Return how long a tone that begins at once takes from 10 to 90 % of what it comes to."""
    count = 2 * round(_BURST_S * rate_hz)
    burst = np.exp(2j * np.pi * hertz / rate_hz * np.arange(count)) * (np.arange(count) < count // 2)
    bins = np.fft.fftfreq(count, 1.0 / rate_hz)
    answer = prediction.displacement(np.abs(bins))
    moved = np.abs(np.fft.ifft(np.fft.fft(burst) * np.where(bins < 0.0, answer.conj(), answer)))[: count // 2]
    steady = float(np.median(moved[count // 4 :]))
    first, last = (int(np.argmax(moved >= share * steady)) for share in (0.1, 0.9))
    return (last - first) / rate_hz


def sheet_text(sheet: DeviceSheet) -> str:
    """Return the fact sheet of a device as Markdown."""
    best = int(np.argmax(sheet.level_db_sl))
    at = int(np.flatnonzero(sheet.frequency_hz == sheet.strongest_hz)[0])
    jnd_hz = FREQUENCY_JND * sheet.strongest_hz
    facts: Mapping[str, str] = {
        "Headroom": f"{sheet.acceleration_g[at]:.3g} g peak at {sheet.strongest_hz:.4g} Hz, "
        f"{sheet.level_db_sl[best]:.1f} dB SL at {sheet.frequency_hz[best]:.4g} Hz",
        "Band (10 dB SL or more)": f"{sheet.band_hz[0]:g} to {sheet.band_hz[1]:g} Hz",
        f"Rise under its controller, 10 to 90 %, at {sheet.strongest_hz:.4g} Hz": f"{1e3 * sheet.rise_s:.1f} ms",
        "Amplitude JND": f"{AMPLITUDE_JND_DB:g} dB: {sheet.level_db_sl[best] / AMPLITUDE_JND_DB:.0f} steps",
        "Frequency JND": f"{100.0 * FREQUENCY_JND:g} %, {jnd_hz:.1f} Hz at {sheet.strongest_hz:.4g} Hz: "
        f"{np.log(sheet.band_hz[1] / sheet.band_hz[0]) / np.log1p(FREQUENCY_JND):.0f} steps in the band",
        "Threshold curve": sheet.curve,
        "Felt error": "measured" if sheet.measured else "by the controller's model: nothing was measured",
    }
    columns = zip(
        sheet.frequency_hz, sheet.level_db_sl, sheet.acceleration_g, sheet.displacement_mm, sheet.binding, strict=True
    )
    lines = [
        f"# {sheet.display}: {sheet.channel}", "",
        "Accelerations and displacements are peaks, of one sinusoid at a time, untouched.", "",
        "| fact | value |", "|---|---|", *(f"| {name} | {value} |" for name, value in facts.items()), "",
        "| frequency (Hz) | level (dB SL) | acceleration (g) | displacement (mm) | stopped by |",
        "|---|---|---|---|---|",
        *(f"| {hertz:.4g} | {level:.1f} | {g:.4g} | {mm:.4g} | {limit} |" for hertz, level, g, mm, limit in columns),
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def acceleration_g(wave: FloatArray, head: ReferenceHead, channel: str) -> FloatArray:
    """Return the acceleration (g) that a reference (n,) asks for on a channel, weighted with zero phase; beyond the
    reference's band the weight is that of its ends. Raises BadInput for a curve that is not in the library.
    """
    name, digest = head.curves.get(channel, ("", ""))
    if name not in curve_names() or curve(name).content_hash != digest:
        raise BadInput(f"curve {name or 'unknown'}", ", ".join(curve_names()), where=(channel,))
    size = scipy.fft.next_fast_len(2 * wave.size)
    hertz = np.clip(scipy.fft.rfftfreq(size, 1.0 / head.rate_hz), *(head.band_hz or (1.0, 400.0)))
    weight = (2.0 * np.pi * hertz) ** 2 * curve(name).displacement_mm(hertz) * 1e-3 / GRAVITY_M_S2
    return np.asarray(scipy.fft.irfft(scipy.fft.rfft(wave, size) * weight, size)[: wave.size])

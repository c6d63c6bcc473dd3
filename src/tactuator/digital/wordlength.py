"""Word length: what each number format leaves of a designed controller, and the smallest one that is safe.

The paper's remark on sampling rate and resolution in figures: coefficients of filters written in 1/z need more bits
the faster the loop is sampled, those in d = z - 1 do not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactuator.digital.controller import ChannelController, Controller
from tactuator.digital.discretise import bilinear, zero_order_hold
from tactuator.digital.quantised import (
    BITS_MOST,
    Form,
    delta_poles,
    delta_response,
    delta_zeros,
    is_inside,
    quantised_delta,
)
from tactuator.digital.roundoff import core_step, double_step, felt_db_sl, run_loop
from tactuator.errors import BadInput
from tactuator.loop.stability import closed_roots
from tactuator.plant.display import Channel, Display
from tactuator.signals.systems import ContinuousSystem, SampledSystem

ERROR_MAX_DB = 0.1
FELT_MAX_DB_SL = -6.0
_SETTLE_S, _LISTEN_S = 0.8, 0.5
_LEVEL = 30.0


@dataclass(frozen=True)
class NumberFormat:
    """A way to write the controller. bits: fractional bits of fixed point, None: float32. loads: the image's format."""

    name: str
    form: Form
    bits: int | None
    loads: str | None


FORMATS: tuple[NumberFormat, ...] = (
    NumberFormat("q15 biquads", "biquad", 14, None),
    NumberFormat("float32 biquads", "biquad", None, None),
    NumberFormat("q31 biquads", "biquad", 29, None),
    NumberFormat("float32", "delta", None, "float32"),
    NumberFormat("q31", "delta", 30, "q31"),
)
"""From the smallest word upwards, and by what they cost; those with `loads` are what a board runs (delta form)."""


@dataclass(frozen=True)
class FormatReport:
    """What a format does to a controller, over its worst channel.

    response_error_db: worst |H| error over the band. roundoff_db_sl: felt, at a constant reference; limit_cycle_db_sl:
    felt, after the reference has gone to zero; both None where the format is not stable or not one that a board runs.
    """

    name: str
    stable: bool
    response_error_db: float | None
    roundoff_db_sl: float | None
    limit_cycle_db_sl: float | None
    loads: str | None
    safe: bool


def assess(controller: Controller, formats: tuple[NumberFormat, ...] = FORMATS) -> tuple[FormatReport, ...]:
    """Every format, worst channel."""
    return tuple(_report(controller, number_format) for number_format in formats)


def recommended(reports: tuple[FormatReport, ...]) -> str | None:
    """The smallest safe format that a board runs, or None."""
    return next((report.loads for report in reports if report.safe and report.loads), None)


def require_safe(controller: Controller, loads: str) -> FormatReport:
    """The report of the format that an image is to have; BadInput, with the figures, if it is not safe."""
    wanted = tuple(each for each in FORMATS if each.loads == loads)
    if not wanted:
        allowed = ", ".join(each.loads for each in FORMATS if each.loads)
        raise BadInput(f"format is {loads!r}; allowed: {allowed}")
    report = assess(controller, wanted)[0]
    if not report.safe:
        error = "unstable" if report.response_error_db is None else f"{report.response_error_db:.3g} dB off"
        raise BadInput(
            f"format {loads} is not safe for this controller ({error}); allowed: what `wordlength` calls safe"
        )
    return report


def at_rate(controller: Controller, rate_hz: float) -> Controller:
    """The same F and C, bilinear, at another rate (their own continuous counterparts, without prewarping).

    The display's delay stays one of samples. Anti-windup gains scale with the period.
    """
    display: Display = replace(controller.display, rate_hz=rate_hz)
    channels = tuple(_channel_at(channel, controller.rate_hz, rate_hz) for channel in controller.channels)
    return Controller(display, channels, controller.tool)


def _is_stable(rows: NDArray[np.float64], plant: SampledSystem | None) -> bool:
    """A prefilter inside the unit circle (d = 0 apart); a controller whose closed loop is."""
    poles = delta_poles(rows)
    if plant is None:
        return is_inside(poles)
    zeros, gain = delta_zeros(rows)
    delay = np.full(plant.delay_samples, -1.0 + 0.0j)
    closed = closed_roots(
        np.concatenate([zeros, plant.zeros - np.complex128(1.0)]),
        np.concatenate([poles, plant.poles - 1.0, delay]),
        gain * plant.gain,
    )
    return is_inside(closed)


def _report(controller: Controller, number_format: NumberFormat) -> FormatReport:
    display = controller.display
    errors = [
        _channel_error_db(display, channel, own, number_format)
        for channel, own in zip(display.channels, controller.channels, strict=True)
    ]
    stable = all(error is not None for error in errors)
    worst = max((error for error in errors if error is not None), default=None) if stable else None
    levels: list[tuple[float, float]] = []
    if stable and number_format.loads:
        levels = [_levels(controller, index, number_format.loads) for index in range(len(display.channels))]
    roundoff = max((level[0] for level in levels), default=None)
    cycle = max((level[1] for level in levels), default=None)
    quiet = all(level <= FELT_MAX_DB_SL for pair in levels for level in pair)
    safe = stable and worst is not None and worst <= ERROR_MAX_DB and quiet
    return FormatReport(number_format.name, stable, worst, roundoff, cycle, number_format.loads, safe)


def _channel_error_db(
    display: Display, channel: Channel, controller: ChannelController, number_format: NumberFormat
) -> float | None:
    """Worst error of |H| over the band, or None for an unstable one."""
    plant = zero_order_hold(channel.plant, display.rate_hz)
    plant = replace(plant, delay_samples=plant.delay_samples + display.delay_samples)
    low, high = channel.threshold.band_hz
    grid = np.geomspace(low, high, 120)
    total = np.ones(grid.size, dtype=np.complex128)
    for sos, around in ((controller.prefilter_sos, None), (controller.feedback_sos, plant)):
        if sos is None:
            continue
        rows = quantised_delta(sos, number_format.form, number_format.bits)
        if not _is_stable(rows, around):
            return None
        pair = [
            delta_response(each, grid, display.rate_hz) for each in (rows, quantised_delta(sos, "delta", BITS_MOST))
        ]
        if around is not None:
            held = around.response(grid)
            pair = [response * held / (1.0 + response * held) for response in pair]
        total = total * pair[0] / pair[1]
    return float(np.max(np.abs(20.0 * np.log10(np.abs(total)))))


def _levels(controller: Controller, index: int, loads: str) -> tuple[float, float]:
    """Felt round-off at a constant reference, and what cycles on after it has gone."""
    display, channel = controller.display, controller.display.channels[index]
    rate = display.rate_hz
    settle, listen = round(_SETTLE_S * rate), round(_LISTEN_S * rate)
    reference = np.concatenate([np.full(settle + listen, _LEVEL), np.zeros(settle + listen)])
    runs = [
        run_loop(channel, rate, display.delay_samples, step, reference)
        for step in (core_step(controller, index, loads), double_step(controller.channels[index]))
    ]
    error = runs[0] - runs[1]
    during, after = error[settle : settle + listen], error[-listen:]
    return felt_db_sl(during, channel, rate), felt_db_sl(after, channel, rate)


def _channel_at(channel: ChannelController, old_hz: float, new_hz: float) -> ChannelController:
    feedback = channel.feedback_sos
    gains = channel.anti_windup.gains
    ratio = old_hz / new_hz
    return replace(
        channel,
        prefilter_sos=_sections_at(channel.prefilter_sos, old_hz, new_hz),
        feedback_sos=None if feedback is None else _sections_at(feedback, old_hz, new_hz),
        anti_windup=replace(channel.anti_windup, gains=(gains[0] * ratio, gains[1] * ratio**2)),
    )


def _sections_at(sos: NDArray[np.float64], old_hz: float, new_hz: float) -> NDArray[np.float64]:
    """Each section by itself, so that the order (and the integrator's place) stays."""
    rows = [_section_at(section[None, :], old_hz, new_hz) for section in sos]
    return np.concatenate(rows)


def _section_at(section: NDArray[np.float64], old_hz: float, new_hz: float) -> NDArray[np.float64]:
    sampled = SampledSystem.from_sections(section, old_hz)
    finite = sampled.zeros[np.abs(sampled.zeros + 1.0) > 1e-9]
    zeros = 2.0 * old_hz * (finite - 1.0) / (finite + 1.0)
    poles = 2.0 * old_hz * (sampled.poles - 1.0) / (sampled.poles + 1.0)
    shape = ContinuousSystem(zeros, poles, 1.0)
    reference_hz = 10.0
    before, unit = (system.response(np.array([reference_hz])) for system in (sampled, bilinear(shape, old_hz)))
    gain = float(np.real(before[0] / unit[0]))
    return bilinear(ContinuousSystem(zeros, poles, gain), new_hz).sections()

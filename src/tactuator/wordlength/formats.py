"""Number formats: what each leaves of a channel's F and C, and the arithmetic in which it computes them.

biquads   second-order sections in 1/z, as filters are usually written; examined, never loaded
delta     what a board runs (core/arithmetic/section.h, section_q31.h): the core itself, from the image's own words

    float32   transposed direct form II          y = b0 x + s1,  s1 = (b1 x - a1 y) + s2,  s2 = b2 x - a2 y
    fixed     direct form I, one wide sum, rounded once to the word; where it is fed back, what rounding took from y
              is added to the next sum (Thong & Liu 1977: error spectrum shaping)

Fixed point has 1000 threshold units and 32 V for full scales at its ends and a power of two between sections, as Q31
has on a board but for its 512 V (tactuator.runtime.coefficients); b shares a power of two within a section, a has
all but two bits behind the point.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.coefficients import (
    REFERENCE_FULL_SCALE,
    VOLTS_FULL_SCALE,
    delta_coefficients,
    full_scales,
    q31_cascade,
)
from tactuator.runtime.image import build_image
from tactuator.signals.systems import check_sections
from tactuator.wordlength.bits import quantised_rows
from tactuator.wordlength.roundoff import Step


class SingleSections:
    """A cascade of sections in float32."""

    def __init__(self, sos: FloatArray) -> None:
        single = (sos / sos[:, 3:4]).astype(np.float32)
        self._coefficients = [(row[0], row[1], row[2], row[4], row[5]) for row in single]
        self._states = [[np.float32(0.0), np.float32(0.0)] for _ in single]

    def __call__(self, value: np.float32) -> np.float32:
        """Step the cascade by one sample."""
        for (b0, b1, b2, a1, a2), state in zip(self._coefficients, self._states, strict=True):
            out = b0 * value + state[0]
            state[0] = (b1 * value - a1 * out) + state[1]
            state[1] = b2 * value - a2 * out
            value = out
        return value


@dataclass(frozen=True)
class _FixedSection:
    """Integers; `b` counts 2^-b_bits, `a` 2^-a_bits."""

    b: tuple[int, int, int]
    b_bits: int
    a: tuple[int, int]
    a_bits: int

    def row(self) -> FloatArray:
        """Return the coefficients that the integers stand for: b0, b1, b2, 1, a1, a2."""
        b = [math.ldexp(value, -self.b_bits) for value in self.b]
        return np.array([*b, 1.0, *(math.ldexp(value, -self.a_bits) for value in self.a)])


FULL_SCALE_V = 32.0
"""Of the fixed-point direct forms' output; coarse words have none to spare."""


class FixedSections:
    """A cascade in words of `bits` (sign included), full_scale_in at its input, 32 V at its output."""

    def __init__(self, sos: FloatArray, rate_hz: float, full_scale_in: float, bits: int, fed_back: bool) -> None:
        sections = check_sections(sos)
        scales = full_scales(sections, rate_hz, full_scale_in, full_scale_out=FULL_SCALE_V)
        self._sections = [_fixed(row / row[3], scales[i] / scales[i + 1], bits) for i, row in enumerate(sections)]
        self._gain = scales[-1] / scales[0]
        self._most, self._fed_back = 2 ** (bits - 1), fed_back
        self._states = [[0, 0, 0, 0, 0] for _ in sections]

    def rows(self) -> FloatArray:
        """Return the rows of what is left of the cascade, in d, from the unit of the input to volts."""
        rows = delta_coefficients(np.stack([section.row() for section in self._sections]))
        rows[0, :3] *= self._gain
        return rows

    def __call__(self, value: int) -> int:
        """Step the cascade by one sample, in units of the last bit."""
        most = self._most
        for section, state in zip(self._sections, self._states, strict=True):
            (b0, b1, b2), (a1, a2), bits = section.b, section.a, section.a_bits
            x1, x2, y1, y2, rest = state
            fresh = b0 * value + b1 * x1 + b2 * x2
            shift = section.b_bits - bits
            total = (fresh >> shift if shift >= 0 else fresh << -shift) + rest - a1 * y1 - a2 * y2
            y = nearest = (total + (1 << (bits - 1))) >> bits
            if not -most <= nearest < most:
                y = saturated(nearest, most)
            rest = total - (y << bits) if self._fed_back and y == nearest else 0
            state[:] = value, x1, y, y1, rest
            value = y
        return value


def saturated(value: int, most: int) -> int:
    """Return the value, limited to -most .. most - 1."""
    return max(-most, min(most - 1, value))


def _fixed(row: FloatArray, gain: float, bits: int) -> _FixedSection:
    b, a = row[:3] * gain, row[4:]
    if np.max(np.abs(a)) > 2.0:
        raise BadInput(f"a coefficient of {np.max(np.abs(a)):g} in a denominator; allowed in fixed point: up to 2")
    b_bits = bits - 1 - math.frexp(float(np.max(np.abs(b))))[1]
    most = 2 ** (bits - 1)
    b0, b1, b2 = (saturated(round(math.ldexp(value, b_bits)), most) for value in b)
    a1, a2 = (saturated(round(math.ldexp(value, bits - 2)), most) for value in a)
    return _FixedSection((b0, b1, b2), b_bits, (a1, a2), bits - 2)


@dataclass(frozen=True)
class Written:
    """One channel in a number format: rows in d that stand for its rounded coefficients (reference to volts, volts to
    volts), and a fresh stepper (reference, position -> command)."""

    prefilter: FloatArray
    feedback: FloatArray | None
    start: Callable[[], Step]


@dataclass(frozen=True)
class NumberFormat:
    """A number format. write: a controller and the index of a channel, to that channel; BadInput where the format
    cannot hold it.

    loads: the image's format, or None where no board runs it.
    """

    name: str
    loads: str | None
    write: Callable[[Controller, int], Written]


def _single_biquads(controller: Controller, index: int) -> Written:
    channel = controller.channels[index]
    feedback_sos, most = channel.feedback_sos, np.float32(channel.limits.command_v)

    def start() -> Step:
        prefilter = SingleSections(channel.prefilter_sos)
        feedback = None if feedback_sos is None else SingleSections(feedback_sos)

        def step(reference: float, position: float) -> float:
            wanted = prefilter(np.float32(reference))
            if feedback is not None:
                wanted = feedback(wanted - np.float32(position))
            return float(max(-most, min(most, wanted)))

        return step

    rate = controller.rate_hz
    ahead = quantised_rows(channel.prefilter_sos, "sections", None, rate)
    behind = None if feedback_sos is None else quantised_rows(feedback_sos, "sections", None, rate)
    return Written(ahead, behind, start)


def _fixed_biquads(bits: int, fed_back: bool) -> Callable[[Controller, int], Written]:
    def write(controller: Controller, index: int) -> Written:
        channel, rate = controller.channels[index], controller.rate_hz
        full = 2 ** (bits - 1)
        per_unit, per_volt = full / REFERENCE_FULL_SCALE, full / FULL_SCALE_V
        most = round(channel.limits.command_v * per_volt)

        def cascades() -> tuple[FixedSections, FixedSections | None]:
            prefilter = FixedSections(channel.prefilter_sos, rate, REFERENCE_FULL_SCALE, bits, fed_back)
            if channel.feedback_sos is None:
                return prefilter, None
            return prefilter, FixedSections(channel.feedback_sos, rate, FULL_SCALE_V, bits, fed_back)

        def start() -> Step:
            prefilter, feedback = cascades()

            def step(reference: float, position: float) -> float:
                wanted = prefilter(saturated(round(reference * per_unit), full))
                if feedback is not None:
                    read = saturated(round(position * per_volt), full)
                    wanted = feedback(saturated(wanted - read, full))
                return float(max(-most, min(most, wanted)) / per_volt)

            return step

        prefilter, feedback = cascades()
        return Written(prefilter.rows(), None if feedback is None else feedback.rows(), start)

    return write


def _single_delta(controller: Controller, index: int) -> Written:
    channel, rate = controller.channels[index], controller.rate_hz
    feedback_sos = channel.feedback_sos
    prefilter = quantised_rows(channel.prefilter_sos, "delta", None, rate)
    feedback = None if feedback_sos is None else quantised_rows(feedback_sos, "delta", None, rate)
    return Written(prefilter, feedback, _core(controller, index, "float32"))


def _q31_delta(controller: Controller, index: int) -> Written:
    channel, rate = controller.channels[index], controller.rate_hz
    prefilter = np.array([each.coefficients for each in q31_cascade(channel.prefilter_sos, rate, REFERENCE_FULL_SCALE)])
    prefilter[0, :3] *= VOLTS_FULL_SCALE / REFERENCE_FULL_SCALE
    feedback = None
    if channel.feedback_sos is not None:
        feedback = np.array([each.coefficients for each in q31_cascade(channel.feedback_sos, rate, VOLTS_FULL_SCALE)])
    return Written(prefilter, feedback, _core(controller, index, "q31"))


def _core(controller: Controller, index: int, loads: str) -> Callable[[], Step]:
    image, parsed = build_image(controller, loads), ffi.new("tact_image *")
    shape = (controller.rate_hz, controller.delay_samples, len(controller.channels))
    refusal = lib.tact_image_parse(parsed, ffi.from_buffer(image), len(image), *shape)
    if refusal:
        raise BadInput(f"the core refuses the image ({refusal})", "one that `build` makes")

    def start() -> Step:
        single = loads == "float32"
        table: Any = ffi.addressof(parsed.tables.single if single else parsed.tables.q31, index)
        state = ffi.new("tact_controller_state *" if single else "tact_controller_q31_state *")
        (lib.tact_controller_reset if single else lib.tact_controller_q31_reset)(state)
        advance = lib.tact_controller_step if single else lib.tact_controller_q31_step
        return lambda r, y, _keep=parsed: float(advance(table, state, r, y))  # type: ignore[misc]

    return start


FORMATS: tuple[NumberFormat, ...] = (
    NumberFormat("q15 biquads", None, _fixed_biquads(16, fed_back=False)),
    NumberFormat("float32 biquads", None, _single_biquads),
    NumberFormat("q31 biquads", None, _fixed_biquads(32, fed_back=False)),
    NumberFormat("q31 biquads fed back", None, _fixed_biquads(32, fed_back=True)),
    NumberFormat("float32", "float32", _single_delta),
    NumberFormat("q31", "q31", _q31_delta),
)
"""From the smallest word upwards, and by what they cost; those with `loads` are what a board runs (delta form)."""

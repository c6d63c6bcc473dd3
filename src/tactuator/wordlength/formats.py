"""Number formats: what each leaves of a channel's F and C, and the arithmetic in which it computes them.

biquads   direct forms (tactuator.wordlength.direct_forms); examined, never loaded
delta     what a board runs (core/arithmetic/section.h, section_q31.h): the core itself, from the image's own words
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.image import build_image
from tactuator.runtime.q31 import REFERENCE_FULL_SCALE, VOLTS_FULL_SCALE, q31_cascade
from tactuator.wordlength.direct_forms import FULL_SCALE_V, FixedSections, SingleSections, saturated
from tactuator.wordlength.quantised import quantised_rows
from tactuator.wordlength.roundoff import Step


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
    left = quantised_rows(channel.prefilter_sos, "sections", None, rate)
    behind = None if feedback_sos is None else quantised_rows(feedback_sos, "sections", None, rate)
    return Written(left, behind, start)


def _fixed_biquads(bits: int, fed_back: bool) -> Callable[[Controller, int], Written]:
    def write(controller: Controller, index: int) -> Written:
        channel, rate = controller.channels[index], controller.rate_hz
        full = 2 ** (bits - 1)
        per_unit, per_volt = full / REFERENCE_FULL_SCALE, full / FULL_SCALE_V
        most = round(channel.limits.command_v * per_volt)

        def made() -> tuple[FixedSections, FixedSections | None]:
            prefilter = FixedSections(channel.prefilter_sos, rate, REFERENCE_FULL_SCALE, bits, fed_back)
            if channel.feedback_sos is None:
                return prefilter, None
            return prefilter, FixedSections(channel.feedback_sos, rate, FULL_SCALE_V, bits, fed_back)

        def start() -> Step:
            prefilter, feedback = made()

            def step(reference: float, position: float) -> float:
                wanted = prefilter(saturated(round(reference * per_unit), full))
                if feedback is not None:
                    read = saturated(round(position * per_volt), full)
                    wanted = feedback(saturated(wanted - read, full))
                return float(max(-most, min(most, wanted)) / per_volt)

            return step

        prefilter, feedback = made()
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
    """Return the core's own step of one channel, from the image."""
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

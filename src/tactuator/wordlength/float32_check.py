"""What float32 leaves of a designed controller: the format of every image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.model.verdict import Finding, Outcome
from tactuator.runtime.image import CHANNELS_MAX, build_image, delta_coefficients
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.systems import SampledSystem
from tactuator.wordlength.bits import is_stable, rows_response
from tactuator.wordlength.roundoff import double_step, felt_db_sl, roundoff_reference, run_loop, single_step

ERROR_MAX_DB, FELT_MAX_DB_SL = 0.1, -6.0
"""What float32 may change |H| by, a sixteenth of a just-noticeable difference, and what may be felt of it."""
_TEST_LEVEL, _OF_LIMIT = 30.0, 0.9
"""Threshold units of the tone and of its constant; share of the command's limit that they may take."""


@dataclass(frozen=True)
class Float32Check:
    """Effects of float32 on the worst channel of a controller.

    response_error_db: greatest error of |H| over the band. roundoff_db_sl: felt round-off under a tone upon a constant;
    limit_cycle_db_sl: felt round-off after the reference has gone to zero. All None where the rounded coefficients
    are not stable, or an image cannot hold the controller (refused: why).
    """

    stable: bool
    response_error_db: float | None = None
    roundoff_db_sl: float | None = None
    limit_cycle_db_sl: float | None = None
    safe: bool = False
    refused: str | None = None

    def __str__(self) -> str:
        if not self.stable:
            return "unstable"
        return (
            f"{self.response_error_db:.3g} dB off, round-off {self.roundoff_db_sl:.3g} dB SL, "
            f"limit cycle {self.limit_cycle_db_sl:.3g} dB SL"
        )


def check_float32(controller: Controller) -> Float32Check:
    """Return what float32 does to the worst channel of a controller."""
    try:
        build_image(controller)
    except BadInput as error:
        return Float32Check(False, refused=str(error))
    channels = range(len(controller.channels))
    if not all(_holds(controller, index) for index in channels):
        return Float32Check(False)
    error_db = max(response_error_db(controller, index) for index in channels)
    levels = np.array([_levels(controller, index) for index in channels])
    roundoff, cycle = (float(worst) for worst in np.max(levels, axis=0))
    safe = error_db <= ERROR_MAX_DB and max(roundoff, cycle) <= FELT_MAX_DB_SL
    return Float32Check(True, error_db, roundoff, cycle, safe)


def built(controller: Controller) -> tuple[bytes, Float32Check]:
    """Return the image of a controller, and what float32 does to it.

    Raises BadInput, with the reason, where a board would refuse it or float32 is not safe for it.
    """
    image = build_image(controller)
    check = check_float32(controller)
    if not check.safe:
        raise BadInput(f"float32 is not safe for this controller ({check})", "what `firmware wordlength` calls safe")
    return image, check


def buildable(controller: Controller) -> Finding:
    """Return the finding that a board takes the controller; not judged where none does and the display is wired to a
    sound card, which takes no image.
    """
    try:
        with np.errstate(all="ignore"):  # a figure that float32 does not hold ends as a refusal, not as a warning
            _, check = built(controller)
    except BadInput as error:
        if controller.display.sound is not None:
            remark = f"the display is wired to a sound card, which takes no image; a board would not take it: {error}"
            return Finding("build", "all", "", Outcome.NOT_JUDGED, "no image", remark=remark)
        return Finding("build", "all", "", Outcome.NOT_MET, "no image", remark=str(error))
    remark, error_db = f"a board takes up to {CHANNELS_MAX} channels", check.response_error_db
    return Finding("build", "all", "", Outcome.MET, "error of |H|", error_db, ERROR_MAX_DB, "dB", remark=remark)


def rounded_rows(controller: Controller, index: int) -> tuple[FloatArray, FloatArray | None]:
    """Return F and C of a channel as an image has them: arrays (n, 5) of sections in d = z - 1."""
    channel = controller.channels[index]
    prefilter, feedback = (
        None if sos is None else delta_coefficients(sos).astype(np.float32).astype(np.float64)
        for sos in (channel.prefilter_sos, channel.feedback_sos)
    )
    assert prefilter is not None
    return prefilter, feedback


def _holds(controller: Controller, index: int) -> bool:
    """Return whether F's poles lie inside the unit circle, and those of the loop that C closes."""
    prefilter, feedback = rounded_rows(controller, index)
    return is_stable(prefilter) and (feedback is None or is_stable(feedback, _loop_plant(controller.display, index)))


def response_error_db(controller: Controller, index: int) -> float:
    """Return the greatest error of |H| of a channel over its band, dB."""
    channel, plant = controller.channels[index], _loop_plant(controller.display, index)
    grid = np.geomspace(*controller.display.channels[index].threshold.band_hz, 120)
    feedback = None if channel.feedback_sos is None else delta_coefficients(channel.feedback_sos)
    exact = delta_coefficients(channel.prefilter_sos), feedback
    responses = [_response(*rows, plant, grid) for rows in (rounded_rows(controller, index), exact)]
    return float(np.max(np.abs(db(responses[0] / responses[1]))))


def _loop_plant(display: Display, index: int) -> SampledSystem:
    return discretise(display.channels[index].plant, display.rate_hz, "zoh", display.delay_samples)


def _response(
    prefilter: FloatArray, feedback: FloatArray | None, plant: SampledSystem, grid: FloatArray
) -> ComplexArray:
    response = rows_response(prefilter, grid, plant.rate_hz)
    if feedback is None:
        return response
    loop = rows_response(feedback, grid, plant.rate_hz) * plant.response(grid)
    return np.asarray(response * loop / (1.0 + loop))


def _levels(controller: Controller, index: int) -> tuple[float, float]:
    """Return the felt round-off while something plays, and that of the limit cycles after it has gone.

    The reference is one whose command stays within its limit: what is corrected there is no round-off.
    """
    display, described, channel = controller.display, controller.display.channels[index], controller.channels[index]
    reference, during, after = roundoff_reference(display.rate_hz, _TEST_LEVEL)
    exact, command_v = run_loop(described, display, double_step(*rounded_rows(controller, index)), reference)
    within_v = _OF_LIMIT * channel.limits.command_v
    share = within_v / max(float(np.max(np.abs(command_v))), within_v)
    error = run_loop(described, display, single_step(channel, display.rate_hz), share * reference)[0] - share * exact
    roundoff, cycle = (felt_db_sl(error[stretch], described, display.rate_hz) for stretch in (during, after))
    return roundoff, cycle

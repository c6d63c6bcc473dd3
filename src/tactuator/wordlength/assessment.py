"""Word length: what each number format leaves of a designed controller, and the smallest one that is safe.

The paper's remark on sampling rate and resolution in figures: coefficients of filters written in 1/z need more bits
the faster the loop is sampled, those in d = z - 1 do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.model.verdict import Finding, Outcome
from tactuator.runtime.coefficients import delta_coefficients
from tactuator.runtime.image import CHANNELS_MAX, build_image
from tactuator.runtime.image import FORMATS as IMAGE_FORMATS
from tactuator.signals.decibels import db
from tactuator.signals.discretise import zero_order_hold
from tactuator.signals.systems import SampledSystem
from tactuator.wordlength.bits import is_stable, rows_response
from tactuator.wordlength.formats import FORMATS, NumberFormat, Written
from tactuator.wordlength.roundoff import exact_loop, felt_db_sl, roundoff_reference, run_loop

ERROR_MAX_DB = 0.1
FELT_MAX_DB_SL = -6.0
_TEST_LEVEL = 30.0
_OF_LIMIT = 0.9


@dataclass(frozen=True)
class FormatReport:
    """Effects of a format on the worst channel of a controller.

    response_error_db: worst |H| error over the band. roundoff_db_sl: felt, under a tone upon a constant;
    limit_cycle_db_sl: felt, after the reference has gone to zero. All None where the format is not stable, or cannot
    hold the controller (refused: why).
    """

    name: str
    stable: bool
    response_error_db: float | None
    roundoff_db_sl: float | None
    limit_cycle_db_sl: float | None
    loads: str | None
    safe: bool
    refused: str | None = None


def assess(controller: Controller, formats: Sequence[NumberFormat] = FORMATS) -> tuple[FormatReport, ...]:
    """Return a report of every format, each over the worst channel."""
    return tuple(_report(controller, number_format) for number_format in formats)


def recommended(reports: Sequence[FormatReport]) -> str | None:
    """Return the smallest safe format that a board runs, or None."""
    return next((report.loads for report in reports if report.safe and report.loads), None)


def require_safe(controller: Controller, loads: str) -> FormatReport:
    """Return the report of the format that an image is to have.

    Raises BadInput, with the figures, if it is not safe.
    """
    wanted = tuple(each for each in FORMATS if each.loads == loads)
    if not wanted:
        allowed = ", ".join(each.loads for each in FORMATS if each.loads)
        raise BadInput(f"format is {loads!r}", f"{allowed}")
    report = assess(controller, wanted)[0]
    if report.refused is not None:
        raise BadInput(report.refused)
    if not report.safe:
        raise BadInput(
            f"format {loads} is not safe for this controller ({_figures(report)})", "what `wordlength` calls safe"
        )
    return report


def _figures(report: FormatReport) -> str:
    if not report.stable:
        return "unstable"
    return (
        f"{report.response_error_db:.3g} dB off, round-off {report.roundoff_db_sl:.3g} dB SL, "
        f"limit cycle {report.limit_cycle_db_sl:.3g} dB SL"
    )


def _report(controller: Controller, number_format: NumberFormat) -> FormatReport:
    name, loads = number_format.name, number_format.loads
    indices = range(len(controller.channels))
    try:
        written = [number_format.write(controller, index) for index in indices]
    except BadInput as error:
        return FormatReport(name, False, None, None, None, loads, False, str(error))
    if not all(holds(controller, index, written[index]) for index in indices):
        return FormatReport(name, False, None, None, None, loads, False)
    error_db = max(response_error_db(controller, index, written[index]) for index in indices)
    levels = np.array([_levels(controller, index, written[index]) for index in indices])
    roundoff, cycle = (float(worst) for worst in np.max(levels, axis=0))
    safe = error_db <= ERROR_MAX_DB and max(roundoff, cycle) <= FELT_MAX_DB_SL
    return FormatReport(name, True, error_db, roundoff, cycle, loads, safe)


def holds(controller: Controller, index: int, written: Written) -> bool:
    """Return whether a channel so written is stable: its prefilter inside the unit circle, and so the loop closed
    around its feedback controller.
    """
    if not is_stable(written.prefilter):
        return False
    return written.feedback is None or is_stable(written.feedback, _loop_plant(controller.display, index))


def response_error_db(controller: Controller, index: int, written: Written) -> float:
    """Return the worst error of |H| over the band, dB, of a channel so written."""
    channel, plant = controller.channels[index], _loop_plant(controller.display, index)
    grid = np.geomspace(*controller.display.channels[index].threshold.band_hz, 120)
    exact = delta_coefficients(channel.prefilter_sos)
    feedback = None if channel.feedback_sos is None else delta_coefficients(channel.feedback_sos)
    responses = [_response(*rows, plant, grid) for rows in ((written.prefilter, written.feedback), (exact, feedback))]
    return float(np.max(np.abs(db(responses[0] / responses[1]))))


def _loop_plant(display: Display, index: int) -> SampledSystem:
    return zero_order_hold(display.channels[index].plant, display.rate_hz, display.delay_samples)


def _response(
    prefilter: FloatArray, feedback: FloatArray | None, plant: SampledSystem, grid: FloatArray
) -> ComplexArray:
    response = rows_response(prefilter, grid, plant.rate_hz)
    if feedback is None:
        return response
    loop = rows_response(feedback, grid, plant.rate_hz) * plant.response(grid)
    return np.asarray(response * loop / (1.0 + loop))


def _levels(controller: Controller, index: int, written: Written) -> tuple[float, float]:
    """Return the felt round-off while something plays, and that of the limit cycles after it has gone.

    It plays softly enough for the command to stay within its limit: what is corrected there is no round-off.
    """
    display, channel = controller.display, controller.display.channels[index]
    reference, during, after = roundoff_reference(display.rate_hz, _TEST_LEVEL)
    within_v = _OF_LIMIT * controller.channels[index].limits.command_v
    exact, command_v = exact_loop(channel, display, written.prefilter, written.feedback, reference)
    share = within_v / max(command_v, within_v)
    error = run_loop(channel, display, written.start(), share * reference) - share * exact
    roundoff, cycle = (felt_db_sl(error[stretch], channel, display.rate_hz) for stretch in (during, after))
    return roundoff, cycle


_ALL = "all"


def built(controller: Controller, number_format: str) -> tuple[bytes, FormatReport]:
    """Return the image of a controller in a number format that is safe for it, and what the format does to it.

    Raises BadInput, with the reason, where a board would refuse it or the format is not safe.
    """
    report = require_safe(controller, number_format)
    return build_image(controller, number_format), report


def buildable(controller: Controller) -> Finding:
    """Return the finding that a board takes the controller in float32, the format that `build` writes unless told; not
    judged where none does and the display is wired to a sound card, which takes no image.
    """
    try:
        with np.errstate(all="ignore"):  # a figure that float32 does not hold ends as a refusal, not as a warning
            _, report = built(controller, IMAGE_FORMATS[0])
    except BadInput as error:
        if controller.display.sound is not None:
            remark = f"the display is wired to a sound card, which takes no image; a board would not take it: {error}"
            return Finding("build", _ALL, "", Outcome.NOT_JUDGED, "no image", remark=remark)
        return Finding("build", _ALL, "", Outcome.NOT_MET, "no image", remark=str(error))
    error_db = report.response_error_db
    remark = f"in {IMAGE_FORMATS[0]}; a board takes up to {CHANNELS_MAX} channels"
    return Finding("build", _ALL, "", Outcome.MET, "error of |H|", error_db, ERROR_MAX_DB, "dB", remark=remark)

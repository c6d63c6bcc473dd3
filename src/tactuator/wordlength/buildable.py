"""A board takes a controller, or refuses it: the rules that `build` holds, as a finding of the verdict."""

from __future__ import annotations

import numpy as np

from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.model.verdict import Finding, Outcome
from tactuator.runtime.image import CHANNELS_MAX, FORMATS, build_image
from tactuator.wordlength.assessment import ERROR_MAX_DB, FormatReport, require_safe

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
            _, report = built(controller, FORMATS[0])
    except BadInput as error:
        if controller.display.sound is not None:
            remark = f"the display is wired to a sound card, which takes no image; a board would not take it: {error}"
            return Finding("build", _ALL, "", Outcome.NOT_JUDGED, "no image", remark=remark)
        return Finding("build", _ALL, "", Outcome.NOT_MET, "no image", remark=str(error))
    error_db = report.response_error_db
    remark = f"in {FORMATS[0]}; a board takes up to {CHANNELS_MAX} channels"
    return Finding("build", _ALL, "", Outcome.MET, "error of |H|", error_db, ERROR_MAX_DB, "dB", remark=remark)

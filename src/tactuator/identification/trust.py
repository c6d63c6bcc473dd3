"""The one rule of trust: what a model is judged by, its limits, and what each decides.

Whether a model is to be trusted, and with it the status of `identify`, follows from these numbers and from nothing
else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactuator.model.plant_model import Decides, QualityCheck

_MOST = 1e9
"""Size beyond which a number is reported as this."""


@dataclass(frozen=True)
class Standard:
    """A number that models are judged by: its name, unit and limit, and what it decides; least: the limit is the least
    that is allowed.
    """

    name: str
    unit: str
    limit: float
    decides: Decides = "refuses trust"
    least: bool = False

    def of(self, value: float, where: str = "", remedy: str = "") -> QualityCheck:
        """Return it with its value; remedy: what may help, reported beyond the limit."""
        size = float(np.clip(np.nan_to_num(value, nan=0.0 if self.least else _MOST), -_MOST, _MOST))
        check = QualityCheck(self.name, size, self.unit, self.limit, self.decides, self.least, where)
        return replace(check, where=", ".join(filter(None, (where, remedy)))) if check.beyond else check


EXPLAINED = Standard("power of the position that the model explains", "%", 0.1, least=True)
FOLLOWING = Standard("power of the position that follows the command and not the model", "%", 0.1)
GROWING = Standard("unstable poles, but no feedback detected", "", 0.0)
LASTING = Standard("resonances that decay more slowly than the record is long", "", 0.0)
FASTEST = Standard("fastest pole over half the sampling rate", "", 1.0)
VALID = Standard("part of the excited octaves that is valid", "%", 20.0, least=True)
BAND_DB = Standard("widest band inside the valid range", "dB", 3.0, "narrows the valid range")
BAND_DEG = Standard("widest phase band inside the valid range", "deg", 20.0, "narrows the valid range")
COHERENT = Standard("coherence of command and position where it is greatest", "", 0.5, least=True)
CLIPPED = Standard("clipped samples of the position", "%", 1.0)
KNOCK = Standard("greatest jump of the residual over its usual size", "", 20.0)
SKEW = Standard("clocks of command and position likely apart", "ppm", 3.0)
CHANGE = Standard("change of the response along the record", "dB", 1.0)
DISTORTION = Standard("distortion over the position", "%", 5.0)
RULED = Standard("power of the command that follows friction alone", "%", 2.0)
RUBBING = Standard("residual over what friction takes", "", 0.5)
FRICTION = Standard("half-width of the Coulomb level", "%", 100.0)
LEFT_OUT = Standard("friction that the method leaves out, over the command", "%", 3.0)
"""Coulomb friction c under a sine of rms u takes 4 c / (pi sqrt(2) u) of it: 3 % moves a response by 0.24 dB."""
FIXED = Standard("fixed value off the record's own", "%", 10.0)
FIXED_DB = Standard("response with what is fixed off the record's own", "dB", 1.0)
HOLD = Standard("evidence on held or filtered (`hold`), over what is needed", "", 1.0, "cannot tell", least=True)
AGAINST = Standard("negative static gain", "", 0.0, "cannot tell")
INTEGRATOR = Standard("record over its slowest time constant", "", 1.0, "cannot tell", least=True)
UNSEEN_INSIDE = Standard("unseen response inside the band", "%", 80.0, least=True)
UNSEEN_FOLLOWING = Standard("unseen power that follows the command, over what the band allows", "", 4.0)
UNSEEN_EXPLAINED = Standard("unseen power that the model explains", "%", 0.0, least=True)
RESPONSE_OFF = Standard("mean squared departure from the response over its confidence", "", 10.0)
RESPONSE_LEFT = Standard("scatter of the response about the model", "%", 10.0)
UNLIKELY = Standard("figures of the response that can hardly be", "", 0.0)
RESPONSE_ALIKE = Standard("likeness of neighbouring departures", "", 0.5)

"""Reasons not to trust a model though it could be computed, each in a sentence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactuator.identification.by_prediction import Prepared
from tactuator.identification.result import Identification

_WIDEST_DB = 20.0
_CHANCE, _MISSED = 1e-3, 1e-3
"""Chance of a residual that follows the command so much, and the share of the position's power (3 % of its size), from
which on a model by least squares lacks something."""
_RULED = 0.5
"""Part of the position that is left over, over what friction takes of the command, from which on friction rules."""
_SHORT = 1.1
"""Ratio of its ends below which a range of frequency is none."""


def distrusted(found: Identification, common: Prepared) -> Identification:
    """Return the identification with the reasons, if any, for which its model must not be designed with."""
    model, record = found.model, common.record
    reasons = list(found.distrust)
    poles = np.roots(model.den)
    size = float(np.abs(poles).max())
    unstable = bool(np.any(poles.real > 1e-6 * size))
    if unstable and found.tests.feedback is not True:
        reasons.append("the model is not stable, though the record stays bounded and no feedback can be seen in it")
    sections = [one.fixed.section for one in found.fixed if one.fixed.section]
    known = np.concatenate([np.roots([1.0, *one]) for one in sections]) if sections else np.zeros(0)
    own = [pole for pole in poles if not np.any(np.abs(known - pole) < 1e-6 * size)]
    fastest = float(np.max(np.abs(own), initial=0.0)) / (2.0 * np.pi)
    if fastest > 0.5 * record.rate_hz:
        reasons.append(
            f"a pole at {fastest:.3g} Hz lies beyond half the rate ({0.5 * record.rate_hz:.6g} Hz), where the record "
            "shows nothing"
        )
    low, high = max(common.excitation.low_hz, model.band_hz[0]), min(common.excitation.high_hz, model.band_hz[1])
    if high > low:
        band = model.band_db(np.geomspace(low, high, 100))
        if float(np.max(band)) > _WIDEST_DB:
            reasons.append(f"the band is {float(np.max(band)):.3g} dB wide inside the record's own excitation")
    if model.valid_hz is not None and model.valid_hz[1] < _SHORT * model.valid_hz[0]:
        reasons.append("the band is nowhere narrower than 3 dB and 20 degrees")
    if found.fit_percent < 100.0 * (1.0 - np.sqrt(1.0 - 1e-3)):
        reasons.append("the model explains next to nothing of the position")
    missed = found.tests.unexplained * (1.0 - found.fit_percent / 100.0) ** 2
    if model.method == "rls" and found.tests.uncorrelated_p < _CHANCE and missed > _MISSED:
        reasons.append(
            f"{100.0 * missed:.2g} % of the position's power follow the command and not the model: a dead time, more "
            "poles, or sensor noise, which least squares has no place for (--method refined has)"
        )
    friction = found.friction
    if friction is not None and friction.presliding is None and not found.tests.uncorrelated_with_input:
        left = 1.0 - found.fit_percent / 100.0
        if left * float(np.std(record.command)) > _RULED * friction.coulomb or friction.confidence > friction.coulomb:
            reasons.append(
                f"friction rules the record: it builds up between two samples, {100.0 * left:.2g} % of the position's "
                "size is left over, and how large it is cannot be told; a stronger command or a higher rate shows more"
            )
    remarks = list(found.remarks)
    if unstable and found.tests.feedback is True:
        remarks.append("the model is not stable (the record was made in a closed loop)")
    return replace(found, distrust=tuple(reasons), remarks=tuple(r for r in remarks if r != "the model is not stable"))

"""Step 7: the resolution that the paper's filters need at rising sampling rates, in three forms."""

from __future__ import annotations

import numpy as np

from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis import paper
from tactuator.wordlength.bits import FORMS, BitsNeeded, Needed, filter_bits, loop_bits

RATES_HZ = (4000.0, 8000.0, 16000.0, 32000.0)


def bits_needed() -> Needed:
    """Return the bits for the paper's F, and for its C in the loop with one sample of delay."""
    f: dict[str, dict[float, BitsNeeded]] = {form: {} for form in FORMS}
    c: dict[str, dict[float, BitsNeeded]] = {form: {} for form in FORMS if form != "direct"}
    for rate_hz in RATES_HZ:
        late = SampledSystem(np.empty(0), np.empty(0), 1.0, rate_hz, 1)
        plant = zero_order_hold(paper.PLANT, rate_hz) * late
        for form in FORMS:
            f[form][rate_hz] = filter_bits(bilinear(paper.PREFILTER, rate_hz), form)
            if form in c:
                c[form][rate_hz] = loop_bits(bilinear(paper.FEEDBACK, rate_hz), plant, form)
    return {"prefilter F": f, "feedback C": c}

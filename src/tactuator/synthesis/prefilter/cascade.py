"""A filter as a cascade of sections that is good to compute with."""

from __future__ import annotations

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.signals.sections import exact_sum
from tactuator.signals.systems import SampledSystem


def cascade(system: SampledSystem) -> FloatArray:
    """Return the second-order sections of `system` (shape (n, 6), a0 = 1), each of unit gain at rest but the first,
    which holds the gain of all: the signal keeps its size from section to section. Delay is left out.
    """
    sections = np.array(system.sections())
    for index in range(1, len(sections)):
        at_rest = exact_sum(*sections[index, :3]) / (exact_sum(*sections[index, 3:]) or np.inf)
        size = abs(at_rest)
        if 1e-6 < size < 1e6:
            sections[index, :3] /= at_rest
            sections[0, :3] *= at_rest
    return sections

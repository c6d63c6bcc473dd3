"""Q31 sections against whole numbers of any length, and against the filter they stand for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.digital._core import ffi, lib
from tactuator.digital.q31 import q31_cascade, q31_row
from tactuator.errors import BadInput
from tests.digital.paper_display import feedback_sections, prefilter_sections


def exact(sections, samples):
    """The header's equations in Python's integers."""
    out = []
    states = [[0, 0] for _ in sections]
    for x in samples:
        for section, state in zip(sections, states, strict=True):
            (b0, b1, b2, a1, a2), (k0, k1, k2) = section.mantissas, section.shifts
            y = max(-(2**31), min(2**31 - 1, (state[0] + (b0 * x >> k0) + 2**20) >> 21))
            first, second = (b1 * x - a1 * y) >> k1, (b2 * x - a2 * y) >> k2
            most = 2**61
            state[:] = [max(-most, min(most, state[0] + first + state[1])), max(-most, min(most, state[1] + second))]
            x = y
        out.append(x)
    return out


def core(sections, samples):
    table = ffi.new("tact_section_q31[]", len(sections))
    for row, section in zip(table, sections, strict=True):
        row.b0, row.b1, row.b2, row.a1, row.a2 = section.mantissas
        row.shift0, row.shift1, row.shift2 = section.shifts
    states = ffi.new("tact_section_q31_state[]", len(sections))
    x = np.array(samples, dtype=np.int32)
    y = np.empty_like(x)
    inputs, outputs = ffi.from_buffer("int32_t[]", x), ffi.from_buffer("int32_t[]", y)
    lib.tact_cascade_q31_run(table, states, len(sections), inputs, outputs, x.size)
    return y.tolist()


@given(st.lists(st.integers(-(2**31), 2**31 - 1), min_size=1, max_size=80), st.sampled_from([4000.0, 32000.0]))
@settings(max_examples=60, deadline=None)
def test_section_q31__any_samples__are_the_integers_of_the_header(samples, rate_hz):
    for sos, full in ((prefilter_sections(0.004, rate_hz), 1000.0), (feedback_sections(rate_hz), 32.0)):
        sections = q31_cascade(sos, rate_hz, full)
        assert core(sections, samples) == exact(sections, samples)


def test_section_q31__slow_prefilter__follows_the_double_filter_to_nanovolts():
    from scipy import signal

    sos = prefilter_sections(0.004)
    rng = np.random.default_rng(1)
    reference = rng.uniform(-500.0, 500.0, 4000)
    samples = np.round(reference / 1000.0 * 2**31).astype(np.int64).tolist()
    got = np.array(core(q31_cascade(sos, 4000.0, 1000.0), samples)) * 32.0 / 2**31
    assert np.max(np.abs(got - signal.sosfilt(sos, reference))) < 200e-9


def test_row__too_large__is_refused():
    assert q31_row((0.5, -0.25)) == ((2**30, -(2**29)), 10)
    with pytest.raises(BadInput, match="too large for Q31"):
        q31_row((300.0,))

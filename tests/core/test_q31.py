"""Q31 sections and controllers against APyTypes' fixed-point numbers, bit for bit, and against the filter they stand
for."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import signal

from tactuator.errors import BadInput
from tactuator.model.controller import AntiWindup, Limits
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.coefficients import (
    REFERENCE_FULL_SCALE,
    SHIFT_MAX,
    SHIFT_MIN,
    VOLTS_FULL_SCALE,
    Q31Section,
    q31_cascade,
    q31_conditioning,
    q31_row,
    q31_section,
)
from tactuator.runtime.image import build_image, conditioning, reference_max
from tests.core import fixed_point
from tests.runtime.paper_display import controller, display, feedback_sections, prefilter_sections

FULL, LEAST = 2**31 - 1, -(2**31)
ADVERSARIAL = (
    [1] + [0] * 300,
    [sign * (1 << bit) for bit in range(31) for sign in (1, -1) for _ in range(5)],
    [FULL] * 150 + [LEAST] * 150,
    [FULL, LEAST] * 150,
)

words = st.integers(LEAST, FULL)
mantissa, shift = st.integers(-FULL, FULL), st.sampled_from([SHIFT_MIN, 3, 9, 10, 21, 31, 40, 52, 61, SHIFT_MAX])
any_section = st.builds(Q31Section, st.tuples(*[mantissa] * 5), st.tuples(*[shift] * 3))


def fixed(sections, samples):
    cascade = [fixed_point.FixedSection(section) for section in sections]
    out = []
    for x in samples:
        value = fixed_point.signal(x)
        for section in cascade:
            value = section.step(value)
        out.append(fixed_point.lsb(value))
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


@given(st.lists(words, min_size=1, max_size=80), st.sampled_from([4000.0, 32000.0]))
@settings(max_examples=30, deadline=None)
def test_section_q31__any_samples__are_apytypes_bits(samples, rate_hz):
    for sos, full in ((prefilter_sections(0.004, rate_hz), 1000.0), (feedback_sections(rate_hz), VOLTS_FULL_SCALE)):
        sections = q31_cascade(sos, rate_hz, full)
        assert core(sections, samples) == fixed(sections, samples)


@given(st.lists(any_section, min_size=1, max_size=2), st.lists(words, min_size=1, max_size=40))
@settings(max_examples=150, deadline=None)
def test_section_q31__any_coefficients_even_unstable__are_apytypes_bits(sections, samples):
    assert core(sections, samples) == fixed(sections, samples)


def test_section_q31__adversarial_samples_and_halves_of_a_bit__are_apytypes_bits():
    for sos, full in ((prefilter_sections(0.004), 1000.0), (feedback_sections(), VOLTS_FULL_SCALE)):
        sections = q31_cascade(sos, 4000.0, full)
        for samples in ADVERSARIAL:
            assert core(sections, samples) == fixed(sections, samples)
    half = q31_section([0.5, 0.0, 0.0, 0.0, 0.0])
    assert core([half], [1, 3, 5, -1, -3, -5]) == fixed([half], [1, 3, 5, -1, -3, -5]) == [1, 2, 3, 0, -1, -2]


def test_section_q31__runs_away__stops_where_the_header_says():
    # a double integrator: both states are at +/- 512 full scales within a few samples, and come back from there, not
    # from where 40 samples would have taken them
    integrator = q31_section([0.0, 0.0, 200.0, 0.0, 0.0])
    for sign, other in ((FULL, LEAST), (LEAST, FULL)):
        samples = [sign] * 40 + [other] * 10
        assert core([integrator], samples) == fixed([integrator], samples)
        assert core([integrator], samples)[-1] == other


def parsed(made):
    image, table = build_image(made, "q31"), ffi.new("tact_image *")
    shape = (made.rate_hz, made.delay_samples, len(made.channels))
    assert lib.tact_image_parse(table, ffi.from_buffer(image), len(image), *shape) == lib.TACT_IMAGE_GOOD
    return table


def core_commands(made, reference, position):
    table, state = parsed(made), ffi.new("tact_controller_q31_state *")
    lib.tact_controller_q31_reset(state)
    command = np.empty(reference.size, dtype=np.float32)
    arrays = [ffi.from_buffer("float[]", np.ascontiguousarray(each)) for each in (reference, position, command)]
    own = ffi.addressof(table.tables.q31, 0)
    lib.tact_controller_q31_run(own, state, *arrays, reference.size)
    return command.view(np.uint32)


def fixed_commands(made, reference, position):
    channel = made.channels[0]
    cascades = [
        [] if sos is None else [fixed_point.FixedSection(each) for each in q31_cascade(sos, made.rate_hz, full)]
        for sos, full in ((channel.prefilter_sos, REFERENCE_FULL_SCALE), (channel.feedback_sos, VOLTS_FULL_SCALE))
    ]
    rows = [q31_row((gain,), bits=30) for gain in channel.anti_windup.gains]
    gains = tuple((mantissas[0], shift) for mantissas, shift in rows)
    (worth,), shift = q31_conditioning(conditioning(channel))
    most = round(2**31 * reference_max(channel) / REFERENCE_FULL_SCALE)
    limits = (channel.limits.command_v, (worth, shift), most)
    return fixed_point.run(fixed_point.FixedController(*cascades, gains, *limits), reference, position)


def channels_with(**changes):
    made = controller(display())
    return replace(made, channels=tuple(replace(channel, **changes) for channel in made.channels))


CONTROLLERS = {
    "as designed": channels_with(),
    "anti-windup": channels_with(anti_windup=AntiWindup((0.03, -0.001)), limits=Limits(0.5, 2.0)),
    "without feedback": channels_with(feedback_sos=None),
}
hostile = hnp.arrays(
    np.float32,
    st.integers(1, 40),
    elements=st.one_of(st.floats(width=32), st.floats(-1e3, 1e3, width=32), st.sampled_from([1000.0, -1000.0, 32.0])),
)


@pytest.mark.parametrize("made", CONTROLLERS.values(), ids=CONTROLLERS)
@given(reference=hostile, position=hostile)
@settings(max_examples=30, deadline=None)
def test_controller_q31__any_input__is_apytypes_bits(made, reference, position):
    position = np.resize(position, reference.size)
    expected = fixed_commands(made, reference, position)
    assert np.array_equal(core_commands(made, reference, position), expected)


def test_section_q31__slow_prefilter__follows_the_double_filter_to_a_dozen_last_bits():
    sos = prefilter_sections(0.004)
    rng = np.random.default_rng(1)
    reference = rng.uniform(-500.0, 500.0, 4000)
    samples = np.round(reference / 1000.0 * 2**31).astype(np.int64).tolist()
    got = np.array(core(q31_cascade(sos, 4000.0, 1000.0), samples)) * VOLTS_FULL_SCALE / 2**31
    assert np.max(np.abs(got - signal.sosfilt(sos, reference))) < 3.2e-6


def test_cascade__unstable_section_before_the_last_or_a_coefficient_too_large__is_refused():
    wild = np.array([[1.0, 0.0, 0.0, 1.0, -2.1, 1.2], [1.0, 0.0, 0.0, 1.0, -0.5, 0.0]])
    with pytest.raises(BadInput, match=r"before the last.*allowed: none in Q31"):
        q31_cascade(wild, 4000.0, 1000.0)
    with pytest.raises(BadInput, match="too large for Q31"):
        q31_row((300.0,))

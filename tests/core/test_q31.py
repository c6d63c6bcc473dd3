"""Q31 sections and controllers against APyTypes' fixed-point numbers, bit for bit, and against the filter they stand
for. The words are those of core's section_q31.h and controller_q31.h; every rounding and saturation is one `cast`.

    signal       1 + 31 bits      in full scales                accumulator   12 + 52 bits, kept within +/- 512
    coefficient  mantissa / 2^(21 + shift)

Converters over every code, against a quantiser written with integers alone.
"""

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
import pytest
from apytypes import APyFixed, APyFloat, OverflowMode, QuantizationMode
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import signal

from tactuator.errors import BadInput
from tactuator.model.controller import AntiWindup, Limits
from tactuator.model.description import Converter
from tactuator.runtime import coefficients
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.coefficients import VOLTS_FULL_SCALE, Q31Section, q31_cascade, q31_row, q31_section
from tactuator.runtime.image import build_image, conditioning, reference_max
from tactuator.runtime.tables import converter_table
from tests.core.single_precision import finite
from tests.runtime.paper_display import controller, display, feedback_sections, prefilter_sections

SIGNAL = {"int_bits": 1, "frac_bits": 31}
STATE = {"int_bits": 12, "frac_bits": 52}
MOST = APyFixed(2**61, **STATE)
REST = APyFixed(0, **STATE)
PER_VOLT, PER_THRESHOLD = 2.0**22, float(np.float32(2147483.648))


def word(lsb: int) -> APyFixed:
    return APyFixed(lsb, **SIGNAL)


def lsb(value: APyFixed) -> int:
    """A signal in units of its last bit."""
    return int(value.to_fraction() * 2**31)


def coefficient(mantissa: int, shift: int) -> APyFixed:
    return APyFixed(mantissa, int_bits=11 - shift, frac_bits=21 + shift)


def down(value: APyFixed) -> APyFixed:
    """To an accumulator's last bit, downwards; as wide as it must be."""
    return value.cast(frac_bits=52, quantization=QuantizationMode.TRN)


def bounded(state: APyFixed) -> APyFixed:
    return min(max(state, -MOST), MOST).cast(**STATE)


def saturated(value: APyFixed) -> APyFixed:
    """To a signal: to nearest, halves upwards, stopped at full scale."""
    return value.cast(**SIGNAL, quantization=QuantizationMode.RND, overflow=OverflowMode.SAT)


class FixedSection:
    """One section; what rounding takes from y stays in s1."""

    def __init__(self, section: Q31Section) -> None:
        shifts = [section.shifts[row] for row in (0, 1, 2, 1, 2)]
        self.coefficients = [coefficient(m, shift) for m, shift in zip(section.mantissas, shifts, strict=True)]
        self.s1 = self.s2 = REST

    def shift(self, x: APyFixed) -> APyFixed:
        """What one sample would have left otherwise, had its input been greater by x: a section at rest's own step."""
        s1, s2 = self.s1, self.s2
        self.s1 = self.s2 = REST
        y = self.step(x)
        self.s1, self.s2 = bounded(s1 + self.s1), bounded(s2 + self.s2)
        return y

    def step(self, x: APyFixed) -> APyFixed:
        b0, b1, b2, a1, a2 = self.coefficients
        y = saturated(self.s1 + down(b0 * x))
        self.s1 = bounded(self.s1 + down(b1 * x - a1 * y) + self.s2)
        self.s2 = bounded(self.s2 + down(b2 * x - a2 * y))
        return y


def fixed_of(value: np.float32, scale: float) -> APyFixed:
    """A float32 (finite) times a scale in float32, towards zero; upwards it stops at the last float32 below 2^31."""
    scaled = APyFloat.from_float(float(value), 8, 23) * APyFloat.from_float(scale, 8, 23)
    if scaled.is_inf:
        return word(-(2**31) if scaled.sign else 2**31 - 128)
    wide = APyFixed.from_number(scaled, int_bits=130, frac_bits=150)
    lsbs = wide.cast(frac_bits=0, quantization=QuantizationMode.TRN_ZERO)
    return word(int(max(-(2**31), min(2**31 - 128, lsbs.to_fraction()))))


@dataclass
class FixedController:
    """anti_windup: mantissa and shift of each state's gain. command_v: the limit."""

    prefilter: list[FixedSection]
    feedback: list[FixedSection]
    anti_windup: tuple[tuple[int, int], tuple[int, int]]
    command_v: float
    conditioning: tuple[int, int]
    reference_max: int

    def step(self, reference: np.float32, position_v: np.float32) -> np.float32:
        value = asked = fixed_of(finite(reference, 1e6), PER_THRESHOLD)
        for section in self.prefilter:
            value = section.step(value)
        if self.feedback:
            value = saturated(value - fixed_of(finite(position_v, 1e3), PER_VOLT))
            for section in self.feedback:
                value = section.step(value)
        return self._limited(asked, value)

    def _limited(self, asked: APyFixed, wanted: APyFixed) -> np.float32:
        most = fixed_of(np.float32(self.command_v), PER_VOLT)
        command = min(max(wanted, -most), most)
        if self.feedback and command != wanted:
            last, excess = self.feedback[-1], command - wanted
            most = max(abs(asked), word(self.reference_max))
            worth = (coefficient(*self.conditioning) * excess).cast(frac_bits=31, quantization=QuantizationMode.TRN)
            change = saturated(min(max(asked + worth, -most), most) - asked)
            for section in (*self.prefilter, *self.feedback):
                change = section.shift(change)
            first, second = (coefficient(*gain) for gain in self.anti_windup)
            last.s1 = bounded(last.s1 + down(first * (excess - change)))
            last.s2 = bounded(last.s2 + down(second * (excess - change)))
        return np.float32(np.float32(lsb(command)) / np.float32(PER_VOLT))


def run(
    controller: FixedController, reference: NDArray[np.float32], position: NDArray[np.float32]
) -> NDArray[np.uint32]:
    """Bits of the commands."""
    return np.array([controller.step(r, y) for r, y in zip(reference, position, strict=True)], np.float32).view(
        np.uint32
    )


FULL, LEAST = 2**31 - 1, -(2**31)
ADVERSARIAL = (
    [1] + [0] * 300,
    [sign * (1 << bit) for bit in range(31) for sign in (1, -1) for _ in range(5)],
    [FULL] * 150 + [LEAST] * 150,
    [FULL, LEAST] * 150,
)

words = st.integers(LEAST, FULL)
mantissa, shift = (
    st.integers(-FULL, FULL),
    st.sampled_from([coefficients.SHIFT_MIN, 3, 9, 10, 21, 31, 40, 52, 61, coefficients.SHIFT_MAX]),
)
any_section = st.builds(Q31Section, st.tuples(*[mantissa] * 5), st.tuples(*[shift] * 3))


def fixed(sections, samples):
    cascade = [FixedSection(section) for section in sections]
    out = []
    for x in samples:
        value = word(x)
        for section in cascade:
            value = section.step(value)
        out.append(lsb(value))
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
        [] if sos is None else [FixedSection(each) for each in q31_cascade(sos, made.rate_hz, full)]
        for sos, full in (
            (channel.prefilter_sos, coefficients.REFERENCE_FULL_SCALE),
            (channel.feedback_sos, VOLTS_FULL_SCALE),
        )
    ]
    rows = [q31_row((gain,), bits=30) for gain in channel.anti_windup.gains]
    gains = tuple((mantissas[0], shift) for mantissas, shift in rows)
    (worth,), shift = coefficients.q31_conditioning(conditioning(channel))
    most = round(2**31 * reference_max(channel) / coefficients.REFERENCE_FULL_SCALE)
    limits = (channel.limits.command_v, (worth, shift), most)
    return run(FixedController(*cascades, gains, *limits), reference, position)


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


def exact_code(volts: float, bits: int, range_v: float) -> int:
    """Nearest code, halves away from zero as in the device, saturated."""
    half = 2 ** (bits - 1)
    steps = Fraction(volts) * half / Fraction(range_v)
    size = int(abs(steps) + Fraction(1, 2))
    return max(-half, min(half - 1, size if steps > 0 else -size))


def coded(convert: Any, kind: str, converter: Converter, volts: np.ndarray) -> np.ndarray:
    codes, source = (
        np.empty(volts.size, dtype=np.int32),
        np.ascontiguousarray(volts, dtype={"double": float, "float": np.float32}[kind]),
    )
    arrays = ffi.from_buffer(f"{kind}[]", source), ffi.from_buffer("int32_t[]", codes)
    convert(converter_table(converter), *arrays, volts.size)
    return codes


sensed = partial(coded, lib.tact_converter_senses, "double")
commanded = partial(coded, lib.tact_converter_codes, "float")


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_converter__every_code_and_its_edges__are_those_of_the_integers(bits: int) -> None:
    half = 2 ** (bits - 1)
    codes = np.arange(-half, half)
    step = 10.0 / half
    for inside in (-0.49, 0.0, 0.49):
        assert np.array_equal(sensed(Converter(bits=bits), (codes + inside) * step), codes)
    assert np.array_equal(commanded(Converter(bits=bits), codes * step), codes)


@given(st.floats(-12.0, 12.0), st.sampled_from([8, 12, 16, 18, 24]), st.sampled_from([1.0, 2.5, 3.3, 10.0]))
def test_converter__any_voltage__is_the_nearest_code(volts: float, bits: int, range_v: float) -> None:
    converter = Converter(bits=bits, range_v=range_v)
    near = {exact_code(volts * (1.0 + tilt), bits, range_v) for tilt in (-1e-15, 0.0, 1e-15)}
    assert sensed(converter, np.array([volts]))[0] in near
    single = float(np.float32(volts))
    near = {exact_code(single * (1.0 + tilt), bits, range_v) for tilt in (-3e-7, 0.0, 3e-7)}
    assert commanded(converter, np.array([volts]))[0] in {code + off for code in near for off in (-1, 0, 1)}


@pytest.mark.parametrize("bits", [8, 16, 24])
def test_converter__command_halfway_between_two_codes__is_the_even_one(bits: int) -> None:
    half = 2 ** (bits - 1)
    codes = np.unique(np.concatenate([np.arange(-9, 9), np.linspace(1 - half, half - 2, 100).astype(int)]))
    volts = np.float32((codes + 0.5) * (8.0 / half))
    halfway = volts == (codes + 0.5) * (8.0 / half)  # in single precision
    expected = np.array([round(code + 0.5) for code in codes.tolist()])
    assert halfway.sum() > 50
    assert np.array_equal(commanded(Converter(bits=bits, range_v=8.0), volts)[halfway], expected[halfway])


def test_converter__beyond_the_range__saturates_both_ways() -> None:
    beyond = np.array([9.9999, 10.0, 1e6, np.inf, -10.0, -10.1, -np.inf, np.nan])
    expected = [32767, 32767, 32767, 32767, -32768, -32768, -32768, 0]
    assert sensed(Converter(), beyond).tolist() == expected
    assert commanded(Converter(), beyond).tolist() == expected

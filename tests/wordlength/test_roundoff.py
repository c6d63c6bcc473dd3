"""Round-off: the stepped loop against responses, and what is left over against facts' figures."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tactuator.model.description import Display
from tactuator.runtime.coefficients import delta_coefficients
from tactuator.signals.discretise import zero_order_hold
from tactuator.wordlength import roundoff as module
from tactuator.wordlength.bits import rows_response
from tactuator.wordlength.formats import FORMATS, Written
from tactuator.wordlength.roundoff import double_step, exact_loop, felt_db_sl, roundoff_reference, run_loop
from tests.runtime.paper_display import channel, controller, display, lock_in, tone

BY_NAME = {each.name: each for each in FORMATS}


def sampled(of: Display) -> Callable[[NDArray[np.float64]], NDArray[np.complex128]]:
    plant = zero_order_hold(of.channels[0].plant, of.rate_hz)
    return replace(plant, delay_samples=plant.delay_samples + of.delay_samples).response


def error_of(written: Written, of: Display, reference: NDArray[np.float64]) -> NDArray[np.float64]:
    exact = double_step(written.prefilter, written.feedback)
    runs = [run_loop(of.channels[0], of, step, reference) for step in (written.start(), exact)]
    return np.asarray(runs[0] - runs[1])


@pytest.mark.parametrize(("delay_samples", "delay_s"), [(1, 0.0), (2, 0.00065)])
def test_run_loop__tone__is_the_loops_response(delay_samples: int, delay_s: float) -> None:
    late = replace(channel(), plant=replace(channel().plant, delay_s=delay_s))
    of = display(late, delay_samples=delay_samples)
    own = controller(of).channels[0]
    prefilter, feedback = delta_coefficients(own.prefilter_sos), delta_coefficients(own.feedback_sos)
    hertz = 25.0
    y = run_loop(late, of, double_step(prefilter, feedback), tone(hertz, 2.0, 30.0))
    loop = rows_response(feedback, [hertz], 4000.0) * sampled(of)(np.array([hertz]))
    expected = 10.0**1.5 * rows_response(prefilter, [hertz], 4000.0) * loop / (1.0 + loop)
    found = lock_in(y[4000:], hertz)
    assert found * 1j == pytest.approx(expected[0], rel=1e-5)  # lock_in's zero phase is a cosine


def test_felt_level__sinusoids__are_their_sensation_levels_and_nothing_beyond_the_band_or_in_silence() -> None:
    of, time_s = channel(), np.arange(2000) / 4000.0
    for hertz, level in ((20.0, -30.0), (100.0, 0.0), (250.0, 12.0)):
        amplitude = float(of.threshold_voltage(hertz)) * 10.0 ** (level / 20.0)
        wave = 0.3 + amplitude * np.sin(2.0 * np.pi * hertz * time_s)  # the constant is not felt
        assert felt_db_sl(wave, of, 4000.0) == pytest.approx(level, abs=0.1)
    # 1 V at 1200 Hz; at 300 Hz, where the band ends, it would be 90 dB SL: the window leaks that little
    assert felt_db_sl(np.sin(2.0 * np.pi * 1200.0 * time_s), of, 4000.0) < -60.0
    assert felt_db_sl(np.full(2000, 0.75), of, 4000.0) == -300.0


# Facts, section 2: rms in y at a constant 0.1234 V. Direct forms within a factor of 5, since it depends on how poles
# and zeros are paired; the core's own within 2.
FACTS = [
    ("float32 biquads", 4000.0, 73e-6, 5.0),
    ("q31 biquads", 4000.0, 150e-6, 5.0),
    ("float32", 4000.0, 0.3e-6, 2.0),
    ("float32 biquads", 16_000.0, 7e-3, 2.0),
]


@pytest.mark.parametrize(("name", "rate_hz", "rms_v", "factor"), FACTS)
def test_roundoff__constant_reference__is_facts(name: str, rate_hz: float, rms_v: float, factor: float) -> None:
    of = display(channel(), rate_hz=rate_hz)
    made = controller(of)
    count = round(1.5 * rate_hz)
    reference = np.full(count, 0.1234 / made.channels[0].threshold_voltage_dc)
    error = error_of(BY_NAME[name].write(made, 0), of, reference)[-round(0.5 * rate_hz) :]
    assert rms_v / factor < float(np.sqrt(np.mean(error**2))) < rms_v * factor


@pytest.mark.parametrize(
    ("delay_samples", "delay_s", "fed_back"), [(1, 0.0, True), (2, 0.00065, True), (0, 0.0, True), (1, 0.0, False)]
)
def test_exact_loop__within_the_limit__is_the_stepped_loop(delay_samples, delay_s, fed_back, monkeypatch) -> None:
    late = replace(channel(), plant=replace(channel().plant, delay_s=delay_s))
    of = display(late, delay_samples=delay_samples)
    own = controller(display(late)).channels[0]
    rows = delta_coefficients(own.prefilter_sos), delta_coefficients(own.feedback_sos) if fed_back else None
    reference = roundoff_reference(4000.0, 30.0)[0][::4]
    stepped = run_loop(late, of, double_step(*rows), reference)
    monkeypatch.setattr(module, "run_loop", None)  # it is run at once
    found, command_v = exact_loop(late, of, *rows, reference)
    assert command_v > 0.0
    np.testing.assert_allclose(found, stepped, rtol=0.0, atol=1e-9 * float(np.max(np.abs(stepped))))


def test_exact_loop__more_states_than_the_core_takes__is_stepped_to_the_same() -> None:
    of = display(channel())
    own = controller(of).channels[0]
    rows = delta_coefficients(own.prefilter_sos), delta_coefficients(own.feedback_sos)
    through = np.tile([1.0, 0.5, 0.25, 0.5, 0.25], (8, 1))  # sections that change nothing
    reference = np.linspace(0.0, 30.0, 400)
    few, many = (
        exact_loop(of.channels[0], of, np.vstack([rows[0], more]), rows[1], reference)
        for more in (through[:0], through)
    )
    np.testing.assert_allclose(many[0], few[0], rtol=1e-9, atol=1e-12)
    assert many[1] == pytest.approx(few[1])

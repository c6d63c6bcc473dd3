"""The check of float32 against the words of the image, fifty digits, and facts' round-off."""

import struct
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tactuator.errors import BadInput
from tactuator.model.controller import Controller, Limits
from tactuator.model.description import Display
from tactuator.runtime.image import build_image, delta_coefficients
from tactuator.signals.discretise import discretise
from tactuator.wordlength.bits import at_rate, rows_response
from tactuator.wordlength.float32_check import (
    Float32Check,
    built,
    check_float32,
    response_error_db,
    rounded_rows,
)
from tactuator.wordlength.roundoff import double_step, felt_db_sl, run_loop, single_step
from tests.runtime.paper_display import changed, channel, controller, display, lock_in, louder, tone
from tests.signals.precisely import difference_response, polynomial_response

MADE = controller(display(channel()))
BAND = np.geomspace(0.4, 300.0, 120)
FIGURES = ("response_error_db", "roundoff_db_sl", "limit_cycle_db_sl")


def test_check__papers_controller__is_safe_and_hardly_rounded() -> None:
    found = check_float32(MADE)
    assert found.safe
    assert found.response_error_db == pytest.approx(0.0, abs=1e-5)
    assert found.limit_cycle_db_sl < found.roundoff_db_sl < -80.0


def test_check__command_too_weak_for_the_tone__round_off_alone_is_judged() -> None:
    """What is corrected at a limit was once told as a round-off of 16 dB SL."""
    weak = check_float32(changed(MADE, limits=replace(MADE.channels[0].limits, command_v=0.2)))
    assert weak.safe
    assert weak.roundoff_db_sl == pytest.approx(check_float32(MADE).roundoff_db_sl, abs=12.0)


def test_check__loop_that_does_not_close__is_not_stable_and_no_image_is_built() -> None:
    assert check_float32(louder(MADE, 60.0)) == Float32Check(False)
    with pytest.raises(BadInput, match=r"float32 is not safe for this controller \(unstable\); expected what"):
        built(louder(MADE, 60.0))


def test_check__what_no_image_holds__is_told() -> None:
    wide = changed(MADE, limits=Limits(40.0, 2.0))
    found = check_float32(wide)
    assert (found.safe, found.stable) == (False, False)
    assert found.refused is not None
    assert "its command limit is out of range" in found.refused
    with pytest.raises(BadInput, match="its command limit is out of range"):
        built(wide)


def test_check__several_channels__the_worst() -> None:
    both = check_float32(controller(display(channel("index"), channel("thumb"))))
    alone = [check_float32(controller(display(channel(name)))) for name in ("index", "thumb")]
    for figure in FIGURES:
        assert getattr(both, figure) == max(getattr(each, figure) for each in alone)


def test_check__no_feedback__is_judged_by_the_prefilter_alone() -> None:
    assert check_float32(changed(MADE, feedback_sos=None)).safe


def loop_error_db(made: Controller, left: tuple[NDArray[np.complex128], ...]) -> float:
    """Worst |H| error where F and C are `left`."""
    of, own = made.display, made.channels[0]
    held = sampled(of)(BAND)
    exact = [np.ones(BAND.size, dtype=np.complex128) for _ in left]
    for total, sos in zip(exact, (own.prefilter_sos, own.feedback_sos), strict=True):
        for row in sos.tolist():
            above, below = (polynomial_response(words, BAND, made.rate_hz) for words in (row[:3], row[3:]))
            total *= above / below
    responses = [f * c * held / (1.0 + c * held) for f, c in (left, exact)]
    return float(np.max(np.abs(20.0 * np.log10(np.abs(responses[0] / responses[1])))))


@pytest.mark.parametrize("rate_hz", [4000.0, 64_000.0])
def test_response_error__any_rate__is_that_of_the_images_own_words(rate_hz: float) -> None:
    made = at_rate(MADE, rate_hz)
    counts = len(made.channels[0].prefilter_sos), len(made.channels[0].feedback_sos)
    image = build_image(made)  # the sections are the last of an image of one channel, before its CRC
    rows = list(struct.iter_unpack("<5f", image[-4 - 20 * sum(counts) : -4]))
    left = [
        np.prod([difference_response(row, BAND, rate_hz) for row in cascade], axis=0)
        for cascade in (rows[: counts[0]], rows[counts[0] :])
    ]
    assert response_error_db(made, 0) == pytest.approx(loop_error_db(made, tuple(left)), rel=0.02, abs=2e-9)


def sampled(of: Display) -> Callable[[NDArray[np.float64]], NDArray[np.complex128]]:
    plant = discretise(of.channels[0].plant, of.rate_hz, "zoh")
    return replace(plant, delay_samples=plant.delay_samples + of.delay_samples).response


@pytest.mark.parametrize(("delay_samples", "delay_s"), [(1, 0.0), (2, 0.00065)])
def test_run_loop__tone__is_the_loops_response(delay_samples: int, delay_s: float) -> None:
    late = replace(channel(), plant=replace(channel().plant, delay_s=delay_s))
    of = display(late, delay_samples=delay_samples)
    own = controller(of).channels[0]
    prefilter, feedback = delta_coefficients(own.prefilter_sos), delta_coefficients(own.feedback_sos)
    hertz = 25.0
    y, u = run_loop(late, of, double_step(prefilter, feedback), tone(hertz, 2.0, 30.0))
    c, plant = rows_response(feedback, [hertz], 4000.0), sampled(of)(np.array([hertz]))
    command = 10.0**1.5 * rows_response(prefilter, [hertz], 4000.0) * c / (1.0 + c * plant)
    for found, expected in ((y, command * plant), (u, command)):
        assert lock_in(found[4000:], hertz) * 1j == pytest.approx(expected[0], rel=1e-5)  # its zero phase is a cosine


def test_felt_level__sinusoids__are_their_sensation_levels() -> None:
    of, time_s = channel(), np.arange(2000) / 4000.0
    for hertz, level in ((20.0, -30.0), (100.0, 0.0), (250.0, 12.0)):
        amplitude = float(of.threshold_voltage(hertz)) * 10.0 ** (level / 20.0)
        wave = 0.3 + amplitude * np.sin(2.0 * np.pi * hertz * time_s)  # the constant is not felt
        assert felt_db_sl(wave, of, 4000.0) == pytest.approx(level, abs=0.1)
    # 1 V at 1200 Hz; at 300 Hz, where the band ends, it would be 90 dB SL: the window leaks that little
    assert felt_db_sl(np.sin(2.0 * np.pi * 1200.0 * time_s), of, 4000.0) < -60.0
    assert felt_db_sl(np.full(2000, 0.75), of, 4000.0) == -300.0


def test_roundoff__constant_reference__is_facts() -> None:
    """Facts, section 2: 0.3 uV rms in y at a constant 0.1234 V, 4 kHz."""
    of, own = MADE.display, MADE.channels[0]
    reference = np.full(6000, 0.1234 / own.threshold_voltage_dc)
    steps = single_step(own, 4000.0), double_step(*rounded_rows(MADE, 0))
    single, double = (run_loop(of.channels[0], of, step, reference)[0][-2000:] for step in steps)
    assert 0.15e-6 < float(np.sqrt(np.mean((single - double) ** 2))) < 0.6e-6

"""Word length: verdicts, errors against rounded words with fifty digits; round-off of the stepped loop."""

import struct
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tactuator.errors import BadInput
from tactuator.model.controller import Controller, Limits
from tactuator.model.description import Display
from tactuator.runtime.coefficients import VOLTS_FULL_SCALE, delta_coefficients
from tactuator.runtime.image import build_image
from tactuator.signals.discretise import zero_order_hold
from tactuator.wordlength import roundoff as module
from tactuator.wordlength.assessment import FormatReport, assess, recommended, require_safe, response_error_db
from tactuator.wordlength.bits import at_rate, rows_response
from tactuator.wordlength.formats import FORMATS, FULL_SCALE_V, Written
from tactuator.wordlength.roundoff import double_step, exact_loop, felt_db_sl, roundoff_reference, run_loop
from tests.runtime.paper_display import changed, channel, controller, display, lock_in, louder, tone
from tests.signals.precisely import difference_response, polynomial_response

MADE = controller(display(channel()))
BY_NAME = {each.name: each for each in FORMATS}
BAND = np.geomspace(0.4, 300.0, 120)


def report(made: Controller, name: str) -> FormatReport:
    return assess(made, (BY_NAME[name],))[0]


@pytest.fixture(scope="module")
def reports() -> dict[str, FormatReport]:
    return {each.name: each for each in assess(MADE)}


def test_assess__papers_controller__is_safe_in_every_format_but_sixteen_bits(reports: dict[str, FormatReport]) -> None:
    assert [name for name, each in reports.items() if not each.safe] == ["q15 biquads"]
    assert not reports["q15 biquads"].stable  # facts, section 2: at every rate
    assert recommended(tuple(reports.values())) == "float32"


def test_assess__order_of_round_off__delta_and_error_feedback_are_quieter(reports: dict[str, FormatReport]) -> None:
    level = {name: each.roundoff_db_sl for name, each in reports.items()}
    cycle = {name: each.limit_cycle_db_sl for name, each in reports.items()}
    assert level["float32"] < level["float32 biquads"] - 20.0
    wider_db = 20.0 * np.log10(VOLTS_FULL_SCALE / FULL_SCALE_V)  # the delta form's last bit is so much greater
    assert level["q31"] - wider_db < level["q31 biquads fed back"] < level["q31 biquads"] - 20.0
    assert cycle["q31"] - wider_db < cycle["q31 biquads"] - 20.0
    assert cycle["q31 biquads fed back"] < cycle["q31 biquads"] - 20.0


def test_response_error__q31_biquads__is_at_most_facts() -> None:
    for made in (at_rate(MADE, rate_hz) for rate_hz in (4000.0, 32_000.0)):
        assert response_error_db(made, 0, BY_NAME["q31 biquads"].write(made, 0)) <= 0.016


def test_assess__command_too_weak_for_the_tone__round_off_alone_is_judged(reports: dict[str, FormatReport]) -> None:
    """What is corrected at a limit was once told as a round-off of 16 dB SL."""
    weak = report(changed(MADE, limits=replace(MADE.channels[0].limits, command_v=0.2)), "q31")
    assert weak.safe
    assert weak.roundoff_db_sl == pytest.approx(reports["q31"].roundoff_db_sl, abs=12.0)


def test_assess__loop_that_does_not_close__is_stable_in_no_format() -> None:
    found = assess(louder(MADE, 60.0))
    assert not any(each.stable or each.safe for each in found)
    assert recommended(found) is None
    with pytest.raises(BadInput, match=r"float32 is not safe for this controller \(unstable\); allowed: what"):
        require_safe(louder(MADE, 60.0), "float32")


def test_assess__several_channels__the_worst() -> None:
    both = controller(display(channel("index"), channel("thumb")))
    alone = [report(controller(display(channel(name))), "float32 biquads") for name in ("index", "thumb")]
    found = report(both, "float32 biquads")
    for figure in ("response_error_db", "roundoff_db_sl", "limit_cycle_db_sl"):
        assert getattr(found, figure) == max(getattr(each, figure) for each in alone)


def test_assess__no_feedback__is_judged_by_the_prefilter_alone() -> None:
    assert report(changed(MADE, feedback_sos=None), "float32").safe


REFUSED = [
    (changed(MADE, limits=Limits(20.0, 2.0)), r"command_v is 20; allowed: at most 15 V in Q31"),
    (
        changed(MADE, feedback_sos=np.array([[400.0, -390.0, 0.0, 1.0, -0.2, 0.0]])),
        r"a coefficient of 400 is too large for Q31; allowed: below 256",
    ),
]


@pytest.mark.parametrize(("made", "words"), REFUSED, ids=["command limit", "coefficient"])
def test_assess__what_q31_cannot_hold__is_told_for_q31_alone(made: Controller, words: str) -> None:
    found = report(made, "q31")
    assert (found.safe, found.stable) == (False, False)
    assert found.refused is not None
    assert report(made, "float32").refused is None
    with pytest.raises(BadInput, match=words):
        require_safe(made, "q31")


def loop_error_db(made: Controller, left: tuple[NDArray[np.complex128], ...]) -> float:
    """Worst |H| error where F and C are `left`."""
    of, own = made.display, made.channels[0]
    plant = zero_order_hold(of.channels[0].plant, of.rate_hz)
    held = replace(plant, delay_samples=plant.delay_samples + of.delay_samples).response(BAND)
    exact = [np.ones(BAND.size, dtype=np.complex128) for _ in left]
    for total, sos in zip(exact, (own.prefilter_sos, own.feedback_sos), strict=True):
        for row in sos.tolist():
            above, below = (polynomial_response(words, BAND, made.rate_hz) for words in (row[:3], row[3:]))
            total *= above / below
    responses = [f * c * held / (1.0 + c * held) for f, c in (left, exact)]
    return float(np.max(np.abs(20.0 * np.log10(np.abs(responses[0] / responses[1])))))


@pytest.mark.parametrize(("name", "rate_hz"), [("float32", 64_000.0), ("q31", 4000.0), ("q31", 64_000.0)])
def test_response_error__delta_form__is_that_of_the_images_own_words(name: str, rate_hz: float) -> None:
    made = at_rate(MADE, rate_hz)
    own = made.channels[0]
    rows = image_rows(build_image(made, name), name, len(own.prefilter_sos), len(own.feedback_sos))
    left = []
    for cascade in rows:
        responses = (difference_response(row, BAND, rate_hz) for row in cascade)
        left.append(np.prod(list(responses), axis=0))
    if name == "q31":
        left[0] *= 512.0 / 1000.0  # full scale of the output over that of the reference
    found = response_error_db(made, 0, BY_NAME[name].write(made, 0))
    assert found == pytest.approx(loop_error_db(made, tuple(left)), rel=0.02, abs=2e-9)


def image_rows(image: bytes, name: str, prefilters: int, feedbacks: int) -> tuple[list[list[float]], list[list[float]]]:
    """b0, b1, b2, a1, a2 of every section: they are the last of an image of one channel, before its CRC."""
    size, rows = (20 if name == "float32" else 24), []
    for at in range(len(image) - 4 - size * (prefilters + feedbacks), len(image) - 4, size):
        if name == "float32":
            rows.append(list(struct.unpack_from("<5f", image, at)))
            continue
        words = struct.unpack_from("<5i4B", image, at)
        shifts = (words[5], words[6], words[7], words[6], words[7])
        rows.append([word / 2.0 ** (21 + shift) for word, shift in zip(words[:5], shifts, strict=True)])
    return rows[:prefilters], rows[prefilters:]


def test_require_safe__format_that_no_board_runs__is_refused() -> None:
    with pytest.raises(BadInput, match="format is 'q31 biquads'; allowed: float32, q31"):
        require_safe(MADE, "q31 biquads")


def test_recommended__only_formats_that_load__and_only_safe_ones() -> None:
    one = FormatReport("a", True, 0.0, -90.0, -90.0, None, True)
    assert recommended((one,)) is None
    assert recommended((one, replace(one, loads="q31", safe=False))) is None
    assert recommended((one, replace(one, loads="q31"), replace(one, loads="float32"))) == "q31"


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

"""Word length: verdicts on known cases, and errors against the rounded words themselves with fifty digits."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tactuator.errors import BadInput
from tactuator.model.controller import Controller, Limits
from tactuator.runtime.coefficients import VOLTS_FULL_SCALE
from tactuator.runtime.image import build_image
from tactuator.signals.discretise import zero_order_hold
from tactuator.wordlength.assessment import FormatReport, assess, recommended, require_safe, response_error_db
from tactuator.wordlength.bits import at_rate
from tactuator.wordlength.formats import FORMATS, FULL_SCALE_V
from tests.runtime.paper_display import changed, channel, controller, display, louder
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

"""Contours that a display follows: by one prefilter, or at every level; and what check and measure say of it."""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.errors import NoDesign
from tactuator.measure.error import ResponseLevels, error_db
from tactuator.model.description import Channel, Converter, Strength, display_document
from tactuator.model.verdict import FELT_MINUS_ASKED, Finding, Outcome
from tactuator.perception.contours import Contours
from tactuator.perception.curve import Contact
from tactuator.rig.board.commissioning import safety_table
from tactuator.signals.decibels import db, from_db
from tactuator.signals.record import Response
from tactuator.synthesis.design import Headroom
from tactuator.synthesis.strength import JUDGED_DB_SL, fit_strength, shaping_error_db
from tactuator.synthesis.verdict import AT_LOWEST, judge_channel
from tactuator.verbs.controller import design
from tests.griffin import distance_db, griffin
from tests.runtime.paper_display import RATE_HZ, channel, display
from tests.strength import blended

HERTZ = np.geomspace(0.4, 300.0, 120)


def asked(**keys: object):
    finger = channel()
    return display(replace(finger, strength=Strength(**keys), prefilter=replace(finger.prefilter, poles=8)))


def response(of, hertz, felt_db_sl, level) -> Response:
    volts = from_db(felt_db_sl) * of.channels[0].threshold_voltage(hertz)
    nothing = np.zeros(hertz.size)
    peak, flags = np.full(hertz.size, from_db(level)), np.zeros(hertz.size, dtype=bool)
    return Response("index", "none", level, "multisine", hertz, volts + 0j, peak, nothing, nothing, nothing, flags,
                    flags, nothing)  # fmt: skip


@pytest.mark.parametrize("level", JUDGED_DB_SL)
def test_fit_strength__of_griffins_contours__keeps_every_level(level: float) -> None:
    shaping = fit_strength(blended(display(channel())).channels[0], RATE_HZ, 1.0)
    hertz = np.array([2.0, 8.0, 30.0, 60.0, 100.0, 160.0, 250.0, 300.0])
    raised = db(np.abs(shaping.response(level, hertz, RATE_HZ)))
    np.testing.assert_allclose(raised, distance_db(hertz, level), atol=0.7)
    assert np.max(np.abs(shaping_error_db(shaping, level, griffin(), HERTZ, RATE_HZ))) < 0.8
    assert np.max(np.abs(shaping.gains)) < 20.0


def test_headroom__of_a_display_that_reshapes__is_where_the_reshaped_tone_meets_the_limit() -> None:
    shaping = fit_strength(blended(display(channel())).channels[0], RATE_HZ, 1.0)
    hertz = np.array([4.0, 30.0, 100.0, 250.0])
    plain = Headroom(hertz, np.array([55.0, 40.0, 12.0, -3.0]), ("comfort",) * 4)
    room = plain.before(shaping, RATE_HZ)
    assert room.binding == plain.binding
    for at, least, most in zip(hertz, room.level_db_sl, plain.level_db_sl, strict=True):
        levels = np.arange(0.0, max(least, 0.0), 0.5)
        reshaped_to = [level + db(np.abs(shaping.response(level, at, RATE_HZ))) for level in levels]
        assert np.all(np.array(reshaped_to) <= most) or least < 0.0
        felt = least + db(np.abs(shaping.response(max(least, 0.0), at, RATE_HZ)))
        assert felt == pytest.approx(most, abs=0.1) or (felt < most and least == pytest.approx(55.0))  # the most asked
    assert room.level_db_sl[1] == pytest.approx(40.0 - distance_db(30.0, 40.0), abs=0.7)
    assert plain.before(None, RATE_HZ) is plain


def test_fit_strength__contours_with_a_cliff__are_no_design() -> None:
    table = np.array([[20.0, 20.0, 5.0, 20.0]])
    cliff = Contours("cliff", [20.0, 50.0, 55.0, 100.0], [20.0], table, provenance="synthetic")
    finger = replace(channel(), strength=Strength(cliff, blended=True))
    with pytest.raises(NoDesign, match="contours are missed by"):
        fit_strength(finger, RATE_HZ, 1.0)


def test_design__for_one_contour__has_it_in_the_prefilter_and_check_says_so() -> None:
    made = design(asked(contours=griffin(), strength_db_sl=40.0))
    assert made.channels[0].strength is None
    felt = db(np.abs(made.response("index", HERTZ)) / made.display.channels[0].threshold_voltage(HERTZ))
    inside = (HERTZ > 2.0) & (HERTZ < 290.0)
    np.testing.assert_allclose(felt[inside], griffin().level_db_sl_at(40.0, HERTZ[inside]) - 40.0, atol=0.6)

    def judged(channel: Channel, quantity: str) -> Finding:
        findings = judge_channel(made.channels[0], channel, made.display)
        (finding,) = (each for each in findings if each.quantity == quantity and each.load == "none")
        return finding

    assert judged(made.display.channels[0], FELT_MINUS_ASKED).outcome is Outcome.MET
    # at another level it is off by what the contours lie apart
    apart = griffin().level_db_sl_at(40.0, HERTZ) - griffin().level_db_sl_at(10.0, HERTZ) - 30.0
    low = judged(made.display.channels[0], AT_LOWEST)
    assert (low.outcome, "blended = true" in low.remark) == (Outcome.NOT_MET, True)
    assert low.value == pytest.approx(np.max(np.abs(apart)), abs=1.0)
    plain = replace(made.display.channels[0], strength=Strength())
    assert judged(plain, FELT_MINUS_ASKED).value == pytest.approx(8.0, abs=1.0)


def test_judge__reshapes_for_other_contours__is_not_told_to_reshape() -> None:
    made = design(blended(display(channel())))
    table = np.array([[14.0, 10.0, 10.0], [54.0, 50.0, 50.0]])
    other = Contours("other", [2.0, 100.0, 300.0], [10.0, 50.0], table, provenance="synthetic")
    finger = made.display.channels[0]
    asks = replace(finger, strength=replace(finger.strength, contours=other), converter=Converter(bits=12))
    (low,) = [f for f in judge_channel(made.channels[0], asks, made.display) if f.quantity == AT_LOWEST]
    assert low.outcome is Outcome.NOT_MET
    assert "more poles in [prefilter]" in low.remark
    assert "blended = true" not in low.remark


def test_design__without_strength__is_what_it_was() -> None:
    bare, stated = design(asked()), design(asked(balance_db=0.0))
    assert bare.content_hash == stated.content_hash
    assert not {"contours", "blended", "strength"} & set(str(display_document(bare.display)).replace("'", " ").split())


def test_balance__of_a_finger__moves_its_whole_level_and_its_limit() -> None:
    more, even = asked(balance_db=3.0), asked()
    levels = [db(np.abs(design(one).response("index", HERTZ))) for one in (more, even)]
    np.testing.assert_allclose(levels[0] - levels[1], 3.0, atol=0.5)
    limits = [safety_table(one).channels[0].reference_max for one in (even, more)]
    assert db(np.array(limits[0] / limits[1])) == pytest.approx(3.0)


@pytest.mark.parametrize("keys", [{"strength_db_sl": 30.0}, {"blended": True}])
def test_measure__of_a_response_on_the_contour__is_felt_as_asked(keys: dict[str, object]) -> None:
    of, hertz = asked(contours=griffin(), **keys), np.array([10.0, 30.0, 250.0])
    on = response(of, hertz, griffin().level_db_sl_at(20.0, hertz), 20.0)
    np.testing.assert_allclose(error_db(on, of), 0.0, atol=1e-9)
    equal = response(of, hertz, np.full(3, 20.0), 20.0)
    assert error_db(equal, of)[1] == pytest.approx(8.0, abs=0.1)
    if "blended" in keys:
        levels = ResponseLevels.of(on, design(of))
        np.testing.assert_allclose(levels.model_db, 0.0, atol=1.0)
        np.testing.assert_allclose(levels.asked_db_sl, griffin().level_db_sl_at(20.0, hertz))


def test_design__for_another_contact_than_the_curves__warns() -> None:
    finger = replace(channel(), contact=Contact("index fingertip", 300.0))
    (notice,) = design(display(finger)).notices()
    assert notice == (
        "index: the threshold curve bolanowski-1988 was not felt alike: site thenar; the display's is index fingertip"
    )
    assert design(display(replace(finger, contact=Contact("thenar")))).notices() == []

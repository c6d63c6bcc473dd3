"""The pages in a real Chromium: a whole session by keyboard, a phone, two tabs, and a server that dies."""

import re
import sqlite3
from contextlib import closing

import pytest

from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.trial import ForcedChoice
from tests.experiment.session.apparatuses import PROTOCOL, controller
from tests.experiment.session.test_yes_no import YES_NO
from tests.web.killing import of_first, undisturbed
from tests.web.study import Subject, asked, kills_and_finish, page, start, started, visible, watch_errors  # noqa: F401

ONE = PROTOCOL[: PROTOCOL.rindex("[[subject]]")]


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """A server that lives, with a subject for each test."""
    subjects = "".join(f'[[subject]]\ncode = "S{number}"\n' for number in (1, 2, 3))
    with_three = started(tmp_path_factory.mktemp("shared"), ONE[: ONE.index("[[subject]]")] + subjects, controller())
    yield with_three
    with_three.kill()


def test_session__answered_by_keyboard_with_the_server_killed__is_the_undisturbed_one(start, page, tmp_path) -> None:
    text = ONE.replace("[30, 90, 210]", "[30, 90]")
    server = start(text, controller())
    page.goto(server.addresses["subject S1"])
    subject = Subject(page, server.protocol)
    page.reload()
    visible(page, "Before we begin")
    assert kills_and_finish(server, subject, 2, seed=1) == 2
    rows = of_first(server.store)[3]
    assert rows == undisturbed(tmp_path / "whole.db", text)
    there = [(row[0], row[2]) for row in rows]
    assert len(set(there)) == len(there)
    assert {(run - 1, number) for run, number in subject.acknowledged} <= set(there)


def test_operator__page__shows_the_track_and_pauses(shared, page, browser) -> None:
    operator = browser.new_page()
    errors = watch_errors(operator)
    operator.goto(shared.addresses["operator"])
    page.goto(shared.addresses["subject S1"])
    subject = Subject(page, shared.protocol)
    while len(subject.acknowledged) < 8:
        subject.act()
    operator.locator("#track circle").nth(3).wait_for()
    assert "30 Hz" in operator.locator("#run").inner_text()
    operator.locator("[data-command=pause]").click()
    operator.locator("#state", has_text="paused").wait_for()
    stands = len(subject.acknowledged)
    for _ in range(20):
        subject.act()
    assert len(subject.acknowledged) <= stands + 1  # the trial that played was finished
    visible(page, "wait for the experimenter")
    operator.locator("[data-command=resume]").click()
    asked(page)
    operator.locator("[data-command=stop]").click()
    operator.locator("#state", has_text="nobody").wait_for()
    assert errors == []
    operator.close()


def test_page__phone__fits_its_width_and_is_answered_by_touch(shared, browser) -> None:
    context = browser.new_context(viewport={"width": 360, "height": 640}, has_touch=True)
    page = context.new_page()
    errors = watch_errors(page)
    page.goto(shared.addresses["subject S2"])
    visible(page, "Before we begin")
    page.locator("#go").tap()
    visible(page, "Which interval has the vibration")
    page.locator("#go").tap()
    asked(page)
    boxes = [button.bounding_box() for button in page.locator(".choice").all()]
    assert len(boxes) == len(ForcedChoice(parse_protocol(ONE).paradigm.intervals).responses)
    assert all(box is not None and box["x"] >= 0 and box["x"] + box["width"] <= 360 for box in boxes)
    assert all(box is not None and min(box["width"], box["height"]) >= 44 for box in boxes)
    assert len({box["y"] for box in boxes}) == 1  # in a row, in the order of time
    assert [box["x"] for box in boxes] == sorted(box["x"] for box in boxes)
    page.locator(".choice").first.tap()
    page.locator("body[data-trial$='/1']").wait_for()  # the next trial of its run
    page.evaluate(
        "() => { window.heard = []; link.heard = handlers.stage; handlers.stage = (message) => {"
        " heard.push([message.stage, page.noise.context !== null]); link.heard(message); }; }"
    )
    page.locator("#others button").tap()  # to leave, while a trial goes on
    visible(page, "Leave the study for good")
    assert page.locator("#others button").last.evaluate("back => back === document.activeElement")
    assert page.evaluate("heard").pop() == ["paused", True]  # the masking sound goes on until the rig is at rest
    assert page.evaluate("page.noise.context") is None
    page.locator("#others button").first.tap()
    visible(page, "You have left")
    assert errors == []
    context.close()


def test_page__second_tab__takes_over_and_gives_back(shared, page, browser) -> None:
    first, second = page, browser.new_page()
    first.goto(shared.addresses["subject S3"])
    visible(first, "Before we begin")
    second.goto(shared.addresses["subject S3"])
    visible(first, "opened in another tab")
    first.keyboard.press("Enter")
    visible(second, "opened in another tab")
    visible(first, "Before we begin")
    second.close()


def test_operator__correction_and_refusal__say_what_was_changed_and_stay_to_be_read(shared, page) -> None:
    page.goto(shared.addresses["operator"])
    page.locator("[data-day]").first.wait_for()
    page.locator("#enrol summary").click()
    page.locator("#enrol-form [name=code]").fill("S1")
    page.locator("#enrol-form button").click()
    page.locator("#banner", has_text="Refused: S1 is enrolled already").wait_for()
    page.wait_for_timeout(1500)  # the page is sent anew every second
    assert page.locator("#banner").is_visible()
    page.locator("[data-day=S1]").click()
    form = page.locator("form.day").nth(1)
    form.locator("button").click()
    assert form.locator("[data-reason]").evaluate("field => field.validity.valueMissing")
    form.locator("[list=groups]").fill("hearing")
    form.locator("[data-reason]").fill("asked again")
    page.evaluate("() => { window.said = []; link.send = (message) => { said.push(message); }; }")
    form.locator("button").click()
    changed = {"type": "correct", "subject": "S1", "reason": "asked again", "group": "hearing", "demographics": {}}
    assert page.evaluate("said") == [changed]


def test_held_key__answers_every_burst_by_its_state(start, browser) -> None:
    text = YES_NO.replace("intervals = 1", "intervals = 1\nheld = true").replace("break_after_trials = 20", "")
    server = start(text, controller())
    page = browser.new_page(bypass_csp=True)
    page.goto(server.addresses["subject S1"])
    visible(page, "Before we begin")
    page.keyboard.press("Enter")
    visible(page, "Hold 1 while you feel it")
    assert page.locator(".choice").count() == 1
    page.keyboard.down("1")
    page.keyboard.press("Enter")
    for trials, turn in ((4, page.keyboard.up), (9, page.keyboard.down), (14, page.keyboard.up)):
        page.wait_for_function(f"Number((document.body.dataset.trial || '').split('/')[1]) >= {trials}")
        assert page.locator(".choice").get_attribute("aria-pressed") == str(turn == page.keyboard.up).lower()
        turn("1")
    assert page.locator(".right, .wrong").count() == 0  # they would hide whether it is held
    page.evaluate("page.demonstration.listen(true); page.demonstration.play({ envelope_db_sl: [30], step_s: 90 })")
    page.keyboard.press("Escape")
    visible(page, "You have paused")
    assert page.evaluate("[page.demonstration.shape, page.demonstration.source]") == [None, None]
    server.kill()
    with closing(sqlite3.connect(server.store)) as store:
        said = "".join(row[0] for row in store.execute("select response from response order by trial_id"))
    assert re.match("1{3,}0{3,}1{3,}", said)

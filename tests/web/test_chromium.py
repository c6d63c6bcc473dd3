"""The pages in a real Chromium: a session by keyboard on any layout, a phone, two tabs, a server that dies, and Escape.

How long an Escape takes is told by `witnesses.stop.escape`: a time on a machine that does other work tells nothing.
"""

from contextlib import closing

import pytest
from playwright.sync_api import expect

from tactuator.experiment.protocol.file import Protocol, parse_protocol
from tactuator.experiment.trial import ForcedChoice
from tactuator.experiment.words import shipped_words
from tests.experiment.session.apparatuses import PROTOCOL, controller
from tests.web.killing import of_first, undisturbed
from tests.web.study import Subject, asked, kills_and_finish, page, start, started, visible, watch_errors  # noqa: F401  # noqa: F401
from witnesses.stop.escape import STATES, subject_page

ONE = PROTOCOL[: PROTOCOL.rindex("[[subject]]")]


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """A server that lives, with a subject for each test."""
    subjects = "".join(f'[[subject]]\ncode = "S{number}"\n' for number in (1, 2, 3))
    with_three = started(tmp_path_factory.mktemp("shared"), ONE[: ONE.index("[[subject]]")] + subjects, controller())
    yield with_three
    with_three.kill()


def test_session__by_keyboard_with_the_server_killed__is_the_undisturbed_one(start, page, tmp_path) -> None:
    text = ONE.replace("[30, 90, 210]", "[30, 90]")
    server = start(text, controller())
    page.goto(server.addresses["subject S1"])
    subject = Subject(page, server.protocol)
    page.reload()
    visible(page, "Before we begin")
    assert kills_and_finish(server, subject, 2, seed=1) == 2
    rows = of_first(server.store)
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
    assert len(boxes) == len(ForcedChoice(parse_protocol(ONE, Protocol).paradigm.intervals).responses)
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
    visible(page, "This cannot be undone")
    assert page.locator("#others button").last.evaluate("back => back === document.activeElement")
    page.locator("#others button").first.tap()
    visible(page, "You have left the study, and your answers may be used")
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
    page.locator("#banner", has_text="Refused: S1 is already enrolled").wait_for()
    page.wait_for_timeout(1500)  # the page is sent anew every second
    assert page.locator("#banner").is_visible()
    assert page.locator("#enrol-form [name=code]").input_value() == "S1"  # nothing typed is lost
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


@pytest.mark.parametrize("locale", ["en-US", "de-DE", "fr-FR", "he-IL", "ar-EG"])
def test_operator__number_typed_with_a_comma__is_sent_as_it_was_typed_in_any_language(shared, browser, locale) -> None:
    with closing(browser.new_context(locale=locale, bypass_csp=True)) as context:
        page = context.new_page()
        page.goto(shared.addresses["operator"])
        page.locator("[data-day=S1]").click()
        page.evaluate("() => { window.said = []; link.send = (message) => { said.push(message); }; }")
        form = page.locator("form.day").first
        page.evaluate("document.documentElement.dir = 'rtl'")
        for name, text in (("skin_temperature_c", "31,5"), ("preload_n", "0,5")):
            form.locator(f"[name={name}]").click()
            assert form.locator(f"[name={name}]").evaluate("field => getComputedStyle(field).direction") == "ltr"
            page.keyboard.press("ControlOrMeta+A")
            page.keyboard.type(text)
        form.locator("button").click()
        [message] = page.evaluate("said")
        assert {name: message[name] for name in ("skin_temperature_c", "preload_n")} == {
            "skin_temperature_c": "31,5", "preload_n": "0,5",
        }  # fmt: skip


def test_demonstration__of_a_subject_who_pauses__is_silent(start, browser) -> None:
    page = browser.new_page(bypass_csp=True)
    page.goto(start(PROTOCOL, controller()).addresses["subject S1"])
    visible(page, "Before we begin")
    page.keyboard.press("Enter")
    visible(page, "Which interval has the vibration")
    page.keyboard.press("Enter")
    asked(page)
    page.evaluate("page.demonstration.listen(true); page.demonstration.play({ envelope_db_sl: [30], step_s: 90 })")
    page.keyboard.press("Escape")
    visible(page, "You have paused")
    assert page.evaluate("[page.demonstration.shape, page.demonstration.source]") == [None, None]
    page.close()


BOXES = """[...document.querySelectorAll("button, #sessions a")].filter((one) => one.checkVisibility())
    .map((one) => one.getBoundingClientRect().toJSON())"""


def test_keys__by_where_they_stand__answer_on_every_layout(start, page) -> None:
    """What an AZERTY board sends for its unshifted digits, and a number pad with and without its lock."""
    page.goto(start(ONE, controller()).addresses["subject S1"])
    page.locator("#others button").first.wait_for()
    page.locator("#go").click()
    visible(page, "Which interval has the vibration")
    page.keyboard.press("Enter")
    asked(page)
    page.evaluate("window.said = []; link.send = (message) => { said.push(message); }")
    for key, code in (("&", "Digit1"), ("é", "Digit2"), ("1", "Digit1"), ("3", "Numpad3"), ("PageDown", "Numpad3")):
        page.evaluate("said.length = 0; page.unsaved = null; setPending({ run: 1, number: 0 })")
        page.evaluate(
            "([key, code]) => document.dispatchEvent(new KeyboardEvent('keydown', { key, code }))", [key, code]
        )
        assert page.evaluate("said.map((one) => one.response)") == [code[-1]], (key, code)
    page.evaluate("said.length = 0; page.unsaved = null; setPending({ run: 1, number: 0 })")
    page.evaluate("document.dispatchEvent(new KeyboardEvent('keydown', { key: '4', code: 'Digit4' }))")
    assert page.evaluate("said") == []


def test_operator__on_a_phone_and_at_200_percent__has_every_button_on_the_screen(start, page) -> None:
    german = ONE.replace("seed = 7", 'seed = 7\nlanguage = "de"')  # it has the longest words
    page.goto(start(german, controller()).addresses["operator"])
    page.locator("[data-start]").wait_for()
    for wide in (390, 640, 720, 1024, 195):  # a phone, screens, and the phone at 200 %
        page.set_viewport_size({"width": wide, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= wide
        boxes = page.evaluate(BOXES)
        assert len(boxes) == 11
        assert all(box["x"] >= 0 and box["x"] + box["width"] <= wide for box in boxes)


INVALID = "[...document.querySelectorAll('[aria-invalid=true]')].map((one) => one.name || one.dataset.demographic)"
FACT = '[[demographic]]\nname = "pta"\nlabel = "PTA"\nkind = "number"\nlow = -20\nhigh = 120\nrequired = true\n'


@pytest.mark.parametrize("language", ["de", "he"])
def test_operator__form_with_what_is_not_allowed__is_refused_in_the_pages_words_at_its_field(
    start, page, language
) -> None:
    words = shipped_words(language)
    text = ONE.replace("seed = 7", f'seed = 7\nlanguage = "{language}"') + "demographics = {pta = 5}\n" + FACT
    page.goto(start(text, controller()).addresses["operator"])
    page.locator("#enrol summary").click()
    enrol, number = page.locator("#enrol-form"), {"low": "-20", "high": "120"}

    def refused(form, field: str, label: str, key: str, **values: object) -> None:
        form.locator("button").first.click()
        allowed = words(f"operator.allowed_{key}", **values)
        reason = words("operator.refused_field", field=label, allowed=allowed)
        expect(page.locator("#banner")).to_have_text(words("operator.refused", reason=reason))
        expect(form.locator("[aria-invalid=true]")).to_have_count(1)
        assert page.evaluate(INVALID) == [field]

    refused(enrol, "code", words("operator.code"), "code")
    enrol.locator("[name=code]").fill("a b")
    refused(enrol, "code", words("operator.code"), "code")
    enrol.locator("[name=code]").fill("C1")
    refused(enrol, "pta", "PTA", "number", **number)
    enrol.locator("[data-demographic=pta]").fill("120")
    enrol.locator("button").click()
    page.locator("[data-day=C1]").click()
    assert page.evaluate(INVALID) == []
    for form in (1, 2):  # the correction, and what is left out
        refused(page.locator("form.day").nth(form), "reason", words("operator.reason"), "text", most=200)


MARKS = {
    **dict.fromkeys(("going on", "interval 2", "feedback", "after a pause"), ()),
    **dict.fromkeys(("interval 1", "interval 3"), pytest.mark.soak),  # as interval 2, but for the lamp
}


PIECES_MS = 100.0
"""Longest tone after an Escape, by the rig's own time: what is computed already, and the fade; an interval has 500."""
ARRIVED, OVER = ("pause", "stopped for today", "leaving, asked how"), "['paused', 'stopped'].includes(page.stage)"


@pytest.mark.parametrize("state", [pytest.param(state, marks=MARKS.get(state, pytest.mark.slow)) for state in STATES])
def test_escape__in_each_state__is_silence_until_the_subject_goes_on(browser, tmp_path, state) -> None:
    """The rig's time stands still until the key has come to the server, however long that takes."""
    with subject_page(browser, tmp_path) as (page, felt, lab):
        STATES[state](page)
        felt.runs.clear()
        page.keyboard.press("Escape")
        tab, first = lab.tabs[1].__self__, len(felt.stretches)
        while state not in ARRIVED and not (tab._interruptions or page.evaluate(OVER)):
            page.wait_for_timeout(5)
        felt.runs.set()
        page.wait_for_function(OVER)
        page.wait_for_timeout(500)
        assert felt.tone_ms(first) <= PIECES_MS
        assert page.evaluate("page.stage") == ("stopped" if state == "stopped for today" else "paused")
        assert page.evaluate("page.noise.context") is None  # the rig is at rest by then


NAMED = (
    PROTOCOL[: PROTOCOL.rindex("[[subject]]")].replace(
        "[study]",
        '[study]\nconsent_by = "name"\ninstructions = "Press the interval that you felt."',
    )
    + "[marks]\nchannel = 'thumb'\n"
)


def tree(page) -> list[tuple[str, str, dict]]:
    """Role, name and properties of every node that is not ignored."""
    session = page.context.new_cdp_session(page)
    session.send("Accessibility.enable")
    nodes = session.send("Accessibility.getFullAXTree")["nodes"]
    session.detach()
    return [
        (
            node.get("role", {}).get("value", ""),
            node.get("name", {}).get("value", ""),
            {one["name"]: one["value"].get("value") for one in node.get("properties", [])},
        )
        for node in nodes
        if not node["ignored"]
    ]


def names(page, role: str) -> list[str]:
    return [name for found, name, _ in tree(page) if found == role]


def focused(page) -> list[tuple[str, str]]:
    return [(role, name) for role, name, about in tree(page) if about.get("focused") and role != "RootWebArea"]


def test_page__without_eyes__is_read_from_consent_to_answer(start, page) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(start(NAMED, controller()).addresses["subject S1"])
    visible(page, "Before we begin")
    assert page.evaluate("document.documentElement.lang") == "en"
    assert focused(page) == [("region", "Before we begin")]  # the text is what is read first
    assert "You may stop at any time." in names(page, "StaticText")
    assert names(page, "textbox") == ["Your name"]
    assert {"I agree (Enter)", "I do not agree"} <= set(names(page, "button"))
    page.locator("#name").press("Enter")
    expect(page.locator("#banner")).to_have_text("Please enter your name, without control characters.")
    assert page.evaluate("page.stage") == "consent"
    page.locator("#name").fill("Ada Example")
    page.locator("#name").press("Enter")
    visible(page, "Which interval has the vibration?")
    assert focused(page)[0][0] == "region"
    page.keyboard.press("Enter")
    asked(page)
    status = next(about for role, name, about in tree(page) if role == "status")
    assert status["live"] == "polite"
    answers = [about for role, name, about in tree(page) if role == "button" and name in ("1", "2", "3")]
    assert len(answers) == 3
    assert not any(about.get("disabled") for about in answers)
    assert "Responses" in names(page, "group")
    assert "progressbar" in [role for role, _, _ in tree(page)] or "Progress" in str(tree(page))
    for name in ("Pause", "Leave the study"):
        assert name in names(page, "button")
    assert all(name for role, name, _ in tree(page) if role in ("button", "textbox", "link"))
    sizes = [page.locator(".choice").nth(number).bounding_box() for number in range(3)]
    assert all(size["width"] >= 100 and size["height"] >= 70 for size in sizes)  # large enough without sight
    page.locator(".choice").nth(1).click()
    visible(page, "Which")

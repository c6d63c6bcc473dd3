"""Tasks in a real Chromium: recognition from the first key to bits, through reloads and kills; and judging by keys."""

import re
import sqlite3
from contextlib import closing
from itertools import permutations
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from sqlalchemy import select

from tactuator.experiment.protocol.file import RecognitionProtocol, StudyProtocol, parse_protocol
from tactuator.experiment.protocol.recognition import block_trials
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store
from tactuator.experiment.words import shipped_words
from tests.browser import drawn
from tests.experiment.session import apparatuses
from tests.experiment.session.apparatuses import rows_of
from tests.experiment.session.recognising import controller, items, protocol_text, scripted_answer  # noqa: F401
from tests.experiment.session.test_judging_task import ESTIMATION, HEAD, ORDER
from tests.web.study import ASKED, STANDS, Server, Subject, asked, finish, page, start, visible, watch_errors  # noqa: F401  # noqa: F401

LABELS = ("M-index", "C-index", "MC-index", "L-index")
SIDES = (("x", "width"), ("y", "height"))
PHONE, LAPTOP = {"width": 360, "height": 640}, {"width": 1280, "height": 720}


@pytest.fixture
def serve(tmp_path, items, controller, start):
    for path in Path(items).iterdir():
        (tmp_path / path.name).symlink_to(path)
    return lambda text: start(text, controller)


def opened(page: Page, server: Server, text: str) -> Subject:
    protocol = parse_protocol(text, RecognitionProtocol)
    keys = {item.label: item.key for item in protocol.item} | {"A": "a", "B": "2"}
    page.goto(server.addresses["subject S1"])
    return Subject(page, server.protocol, lambda run, number: keys[scripted_answer(text, run - 1, number)])


def stored(path: Path) -> list[tuple[int, int, str, str]]:
    store = Store(path)
    query = select(
        schema.run.c.position, schema.trial.c.number, schema.trial.c.correct_response, schema.response.c.response
    ).select_from(schema.run.join(schema.trial).join(schema.response))
    rows = [tuple(row) for row in rows_of(store, query.order_by(schema.trial.c.id))]
    store.close()
    return rows


def planned(text: str) -> list[tuple[int, int, str, str]]:
    protocol = parse_protocol(text, RecognitionProtocol)
    return [
        (block, trial.number, trial.correct, scripted_answer(text, block, trial.number))
        for block in range(len(protocol.block))
        for trial in block_trials(protocol, 0, block)
    ]


def begin(page: Page) -> None:
    visible(page, "Which one was it?")
    page.keyboard.press("Enter")
    asked(page)


def test_training__feedback_then_a_break_of_its_time__and_what_comes(serve, page) -> None:
    text = protocol_text(training=1, test=1, labels=LABELS, extra="[session]\nbreak_s = 1\n")
    server = serve(text.replace("feedback_s = 0.0", "feedback_s = 0.5"))
    subject = opened(page, server, text)
    begin(page)
    first, second = planned(text)[0][2], planned(text)[1][2]
    wrong = next(label for label in LABELS if label != first)
    page.get_by_role("button", name=wrong, exact=True).click()
    visible(page, f"No, it was {first}")
    assert page.locator(".choice.right").inner_text().startswith(first)
    assert page.locator(".choice.wrong").inner_text().startswith(wrong)
    asked(page)
    assert page.locator(".choice.right, .choice.wrong").count() == 0
    page.keyboard.press(str(1 + LABELS.index(second)))
    visible(page, "Right")
    while not page.locator("#status").inner_text().startswith("Time for a break"):
        subject.act()
    go = page.locator("#go")
    assert (go.is_disabled(), go.inner_text()) == (True, "Go on in 1 s")
    page.keyboard.press("Enter")  # too early: nothing comes of it
    page.locator("#go:enabled").wait_for()
    page.keyboard.press("Enter")
    page.locator("#text", has_text="Block 2 of 2: test, 4 trials.").wait_for()


def test_keyboard__tab_and_arrows__reach_every_response_and_the_focus_shows(serve, page) -> None:
    server = serve(text := protocol_text(training=0, test=2, labels=LABELS))
    page.set_viewport_size(LAPTOP)
    opened(page, server, text)
    visible(page, "Which one was it?")
    assert page.locator("#text").evaluate("one => one === document.activeElement")  # what is read first; Enter begins
    begin(page)
    group = page.get_by_role("group", name="Responses").get_by_role("button").all()
    assert [one.locator(".label").inner_text() for one in group] == list(LABELS)
    assert [one.get_attribute("aria-keyshortcuts") for one in group] == ["1", "2", "3", "4"]
    page.keyboard.press("Tab")
    focused = page.locator(":focus")
    assert focused.get_attribute("class") == "choice"
    assert focused.evaluate("element => getComputedStyle(element).outlineStyle") == "solid"
    page.keyboard.press("ArrowRight")
    assert page.locator(":focus .label").inner_text() == LABELS[1]
    page.keyboard.press("Enter")
    page.locator("body[data-trial='1/1']").wait_for()
    asked(page)
    assert page.locator(":focus .label").inner_text() == LABELS[1]  # the focus stays
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("Space")
    page.locator("body[data-trial='1/2']").wait_for()
    assert [row[3] for row in stored(server.store)] == [LABELS[1], LABELS[0]]


def many(count: int) -> str:
    text = protocol_text(training=0, test=1, labels=[f"word-{number}" for number in range(count)])
    return re.sub(r'file = "word-(\d+).wav"\nkey = "(\d+)"', _file_and_key, text)


def _file_and_key(found: re.Match[str]) -> str:
    keys = "123456789abcdefghijklmnopqrstuvwxyz"
    return f'file = "{LABELS[int(found[1]) % 4]}.wav"\nkey = "{keys[int(found[1])]}"'


def test_responses__thirty__fit_phone_and_laptop(serve, page) -> None:
    server, count = serve(many(30)), 30
    page.set_viewport_size(LAPTOP)
    page.goto(server.addresses["subject S1"])
    begin(page)
    for size in (LAPTOP, PHONE, {"width": 640, "height": 360}):
        page.set_viewport_size(size)
        drawn(page)
        boxes = [button.bounding_box() for button in page.locator(".choice").all()]
        assert len(boxes) == count
        if size["height"] < 600:
            continue  # a phone on its side shows thirty by scrolling
        for box in boxes:
            assert min(box["width"], box["height"]) >= 36
            assert 0 <= box["x"] <= box["x"] + box["width"] <= size["width"]
            assert 0 <= box["y"] <= box["y"] + box["height"] <= size["height"]
        assert page.evaluate(
            "[...document.querySelectorAll('.choice')].every((one) => one.scrollWidth <= one.clientWidth)"
        )
        for one, other in permutations(boxes, 2):  # the one is left of the other or above it, or the other way round
            assert any(a[at] + a[of] <= b[at] for a, b in ((one, other), (other, one)) for at, of in SIDES)


def test_operator__page__shows_blocks_matrix_and_results(serve, page, browser) -> None:
    text = protocol_text(training=0, test=2, labels=LABELS)
    server = serve(text)
    operator = browser.new_page()
    errors = watch_errors(operator)
    operator.goto(server.addresses["operator"])
    subject = opened(page, server, text)
    while len(subject.acknowledged) < 5:
        subject.act()
    operator.locator("#run", has_text="of 8 trials").wait_for()
    assert operator.locator("#confusion td").count() == 16
    operator.locator("#runs td", has_text="of 8").wait_for()
    finish(subject)
    operator.locator("#sessions td", has_text="done").wait_for()
    operator.locator("[data-results=S1]").click()
    operator.locator("#results caption", has_text="Information transfer").wait_for()
    right = [int(text) for text in operator.locator("#results .matrix td.right").all_inner_texts() if text.isdigit()]
    assert sum(right) == sum(correct == response for _, _, correct, response in planned(text))
    assert errors == []
    operator.close()


TASKS = {"magnitude": ESTIMATION, "order": ORDER}


def answered(page: Page, keys) -> int:
    """Answer by keys until the session is over; how many answers were given."""
    count, last = 0, None
    for _ in range(5_000):
        stands = page.evaluate(STANDS)
        if stands["done"]:
            return count
        if stands["go"]:
            page.keyboard.press("Enter")
        elif stands["trial"] not in (None, last):
            keys(page, count)
            count, last = count + 1, stands["trial"]
        page.wait_for_timeout(20)
    raise AssertionError("the session does not end")


def typed(page: Page, count: int) -> None:
    """A number by the keyboard, with a point or a comma; the first time something else comes before it."""
    if count == 0:
        page.keyboard.type("0")
        page.keyboard.press("Enter")
        expect(page.locator(".number input")).to_have_attribute("aria-invalid", "true")
        expect(page.locator(".number input")).to_be_editable()  # once the server asks again
        page.keyboard.press("Backspace")
    page.keyboard.type(f"{count + 1},5" if count % 2 else f"{count + 1}.5")
    page.keyboard.press("Enter")


@pytest.mark.parametrize(("task", "language"), [("magnitude", "de"), ("order", "fr")])
def test_judging__by_keyboard_alone__is_answered_to_the_end(start, page, task: str, language: str) -> None:
    text = HEAD.replace("seed = 3", f'seed = 3\nlanguage = "{language}"') + TASKS[task]
    keys = parse_protocol(text, StudyProtocol).task
    server = start(text, apparatuses.controller())
    page.goto(server.addresses["subject S1"])
    expect(page.locator("body")).to_contain_text(keys.asked(shipped_words(language)).prompt)
    count = answered(
        page, typed if task == "magnitude" else lambda page, count: page.keyboard.press(str(1 + count % 2))
    )
    with closing(sqlite3.connect(server.store)) as store:
        given = [response for (response,) in store.execute("select response from response order by trial_id")]
    assert len(given) == count == {"magnitude": 6, "order": 8}[task]
    if task == "magnitude":
        assert given == ["1.5", "2.5", "3.5", "4.5", "5.5", "6.5"]
    if task == "order":
        assert set(given) == set(keys.fingers)

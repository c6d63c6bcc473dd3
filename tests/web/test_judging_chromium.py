"""Tasks of judging in a real Chromium, by keyboard alone: matching, numbers for magnitudes, which finger was first."""

import sqlite3
from contextlib import closing

import pytest
from playwright.sync_api import Page, expect

from tactuator.experiment.protocol.file import parse_any_protocol
from tactuator.experiment.words import shipped_words
from tests.experiment.session.apparatuses import controller
from tests.experiment.session.test_judging_task import ESTIMATION, HEAD, MATCHING, ORDER
from tests.web.study import STANDS, page, start  # noqa: F401

TASKS = {"matching": MATCHING, "magnitude": ESTIMATION, "order": ORDER}


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
        page.keyboard.press("Backspace")
    page.keyboard.type(f"{count + 1},5" if count % 2 else f"{count + 1}.5")
    page.keyboard.press("Enter")


@pytest.mark.parametrize(("task", "language"), [("matching", "en"), ("magnitude", "de"), ("order", "fr")])
def test_judging__by_keyboard_alone__is_answered_to_the_end(start, page, task: str, language: str) -> None:
    text = HEAD.replace("seed = 3", f'seed = 3\nlanguage = "{language}"') + TASKS[task]
    keys = parse_any_protocol(text).task
    server = start(text, controller())
    page.goto(server.addresses["subject S1"])
    expect(page.locator("body")).to_contain_text(keys.asked(shipped_words(language)).prompt)
    count = answered(
        page, typed if task == "magnitude" else lambda page, count: page.keyboard.press(str(1 + count % 2))
    )
    with closing(sqlite3.connect(server.store)) as store:
        given = [response for (response,) in store.execute("select response from response order by trial_id")]
    assert len(given) == count == {"matching": 26, "magnitude": 6, "order": 8}[task]
    if task == "magnitude":
        assert given == ["1.5", "2,5", "3.5", "4,5", "5.5", "6,5"]
    if task == "order":
        assert set(given) == set(keys.fingers)

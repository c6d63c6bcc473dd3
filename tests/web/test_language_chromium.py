"""Keys by where they stand on any layout, and the operator's page in every language on screens of every width."""

import pytest

from tests.experiment.session.apparatuses import controller
from tests.web.study import asked, page, start, visible  # noqa: F401
from tests.web.test_chromium import ONE

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
        page.evaluate("said.length = 0; page.unsaved = null; stand({ run: 1, number: 0 })")
        page.evaluate(
            "([key, code]) => document.dispatchEvent(new KeyboardEvent('keydown', { key, code }))", [key, code]
        )
        assert page.evaluate("said.map((one) => one.response)") == [code[-1]], (key, code)
    page.evaluate("said.length = 0; page.unsaved = null; stand({ run: 1, number: 0 })")
    page.evaluate("document.dispatchEvent(new KeyboardEvent('keydown', { key: '4', code: 'Digit4' }))")
    assert page.evaluate("said") == []


# German has the longest words
@pytest.mark.parametrize("language", ["de", *(pytest.param(each, marks=pytest.mark.slow) for each in ("en", "fr"))])
def test_operator__on_a_phone_and_at_200_percent__has_every_button_on_the_screen(start, page, language) -> None:
    page.goto(start(ONE.replace("seed = 7", f'seed = 7\nlanguage = "{language}"'), controller()).addresses["operator"])
    page.locator("[data-start]").wait_for()
    for wide in (390, 640, 720, 1024, 195):  # a phone, screens, and the phone at 200 %
        page.set_viewport_size({"width": wide, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= wide
        boxes = page.evaluate(BOXES)
        assert len(boxes) == 11
        assert all(box["x"] >= 0 and box["x"] + box["width"] <= wide for box in boxes)

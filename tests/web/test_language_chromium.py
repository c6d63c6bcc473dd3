"""The pages in a language that nobody speaks: a word that is left in the code shows. And keys by where they stand."""

import re

import pytest

from tactuator.experiment.words import shipped_words
from tests.experiment.session.apparatuses import controller
from tests.web.study import ASKED, page, start, watch_errors  # noqa: F401
from tests.web.test_chromium import ONE

OWN = ("short", "index", "S1", "You may stop at any time.", "simulated", "three-finger tactuator", "thumb", "middle")
"""What stands on the pages and is the study's or the rig's own."""

WALK = """() => {
    const walker = document.createTreeWalker(document.documentElement, NodeFilter.SHOW_TEXT), found = [];
    while (walker.nextNode()) {
        const parent = walker.currentNode.parentElement;
        if (!["SCRIPT", "STYLE"].includes(parent.tagName)) found.push(walker.currentNode.textContent);
    }
    for (const node of document.querySelectorAll("[aria-label], [title], [placeholder], [alt]"))
        for (const name of ["aria-label", "title", "placeholder", "alt"]) found.push(node.getAttribute(name) || "");
    return found;
}"""

BOXES = """[...document.querySelectorAll("button, #sessions a")].filter((one) => one.checkVisibility())
    .map((one) => one.getBoundingClientRect().toJSON())"""


def marked(text: str) -> str:
    """Every text in double brackets, its names kept."""
    return f"⟦{text}⟧"


@pytest.fixture
def server(tmp_path, start):
    """A study in a language whose every text is the English one in double brackets."""
    tables: dict[str, list[str]] = {}
    for key, text in shipped_words("en").texts.items():
        table, _, name = key.partition(".")
        tables.setdefault(table, []).append(f'{name} = "{marked(text)}"')
    whole = "".join(f"[{table}]\n" + "\n".join(lines) + "\n" for table, lines in tables.items())
    (tmp_path / "own.toml").write_text(whole, encoding="utf-8")
    text = ONE.replace("seed = 7", 'seed = 7\nlanguage = "qps"\nlanguage_file = "own.toml"')
    return start(text, controller())


def unmarked(page) -> list[str]:
    """Texts of the page, seen or told to readers of screens, that are in no brackets and not the study's own."""
    rest = []
    for text in page.evaluate(WALK):
        left = text
        for _ in range(5):  # a text may hold others
            left = re.sub(r"⟦[^⟦⟧]*⟧", "", left)
        for own in OWN:
            left = left.replace(own, "")
        rest.append(left)
    return [text for text in rest if re.search("[A-Za-z]{2}", text)]


def at_first_trial(page, server) -> None:
    page.goto(server.addresses["subject S1"])
    page.locator("#others button").first.wait_for()
    page.locator("#go").click()
    page.wait_for_timeout(150)
    page.keyboard.press("Enter")
    page.locator(ASKED).first.wait_for(timeout=10_000)


def test_pages__in_a_language_of_ones_own__have_no_other_word(server, page, browser) -> None:
    operator = browser.new_page()
    errors = watch_errors(operator)
    operator.goto(server.addresses["operator"])
    operator.locator("[data-day]").first.wait_for()
    operator.locator("[data-day]").first.click()
    operator.locator("[data-reason]").wait_for()
    page.goto(server.addresses["subject S1"])
    page.locator("#others button").first.wait_for()
    seen = {"consent": unmarked(page), "operator": unmarked(operator)}
    operator.locator("[data-day]").first.click()
    at_first_trial(page, server)
    seen["trial"] = unmarked(page)
    page.keyboard.press("1")
    page.wait_for_timeout(150)
    seen["feedback"] = unmarked(page)
    page.keyboard.press("Escape")
    page.locator("#others button").nth(1).wait_for()
    operator.wait_for_timeout(200)
    seen["paused"], seen["operator, at a call"] = unmarked(page), unmarked(operator)
    page.locator("#others button").nth(1).click()
    seen["leaving"] = unmarked(page)
    page.locator("#others button").first.click()
    page.wait_for_timeout(300)
    seen["left"] = unmarked(page)
    assert page.locator("#status").inner_text() == marked("You have left the study. You may close this page.")
    assert page.evaluate("document.documentElement.lang") == "qps"
    assert {name: texts for name, texts in seen.items() if texts} == {}
    assert errors == []
    operator.close()


def test_keys__by_where_they_stand__answer_on_every_layout(server, page) -> None:
    """What an AZERTY board sends for its unshifted digits, and a number pad with and without its lock."""
    at_first_trial(page, server)
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


@pytest.mark.parametrize("language", ["en", "de", "fr"])
def test_operator__on_a_phone_and_at_200_percent__has_every_button_on_the_screen(start, page, language) -> None:
    page.goto(start(ONE.replace("seed = 7", f'seed = 7\nlanguage = "{language}"'), controller()).addresses["operator"])
    page.locator("[data-start]").wait_for()
    for wide in (390, 640, 720, 1024, 195):  # a phone, screens, and the phone at 200 %
        page.set_viewport_size({"width": wide, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= wide
        boxes = page.evaluate(BOXES)
        assert len(boxes) == 11
        assert all(box["x"] >= 0 and box["x"] + box["width"] <= wide for box in boxes)

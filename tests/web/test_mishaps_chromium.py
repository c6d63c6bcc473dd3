"""Mishaps at the keyboard and in the network, one after another in one session: no answer lost, doubled or changed.

A subject answers by the script of the trials, so that the store must hold, trial for trial, what an undisturbed session
holds, whatever happens between.
"""

import random

import pytest
from playwright.sync_api import Page

from tests.experiment.session.apparatuses import PROTOCOL, controller
from tests.web.killing import of_first, undisturbed
from tests.web.study import ASKED, STANDS, Server, Subject, finish, start, watch_errors  # noqa: F401

TEXT = PROTOCOL[: PROTOCOL.rindex("[[subject]]")].replace("[30, 90, 210]", "[10, 20, 30, 90, 150, 210]")
EARLY = "() => page.pending === null && page.unsaved === null && document.dispatchEvent(" + (
    'new KeyboardEvent("keydown", { key: "1", code: "Digit1", bubbles: true }))'
)
"""Press a key if nothing is asked at this very moment."""
TOGETHER = """(keys) => { for (const key of keys) document.dispatchEvent(new KeyboardEvent("keydown", {
  key, code: /\\d/.test(key) ? `Digit${key}` : key, bubbles: true })); }"""
"""Press keys before anything else can happen on the page: the next trial is not there yet."""


class Mishaps:
    """What goes wrong around the next answer. right: the key that the script gives to the trial that is asked."""

    def __init__(self, page: Page, server: Server, subject: Subject) -> None:
        self.page, self.server, self.subject, self.press = page, server, subject, page.keyboard.press

    @property
    def right(self) -> str:
        self.page.locator(ASKED).first.wait_for(timeout=20_000)
        stands = self.page.evaluate(STANDS)["trial"]
        assert stands
        return self.subject.key(*map(int, stands.split("/")))

    def _together(self, *keys: str) -> None:
        self.page.evaluate(TOGETHER, keys)

    def same_key_twice(self) -> None:
        key = self.right
        self._together(key, key)

    def another_key_after(self) -> None:
        key = self.right
        self._together(key, "1" if key != "1" else "2")

    def every_key_after(self) -> None:
        self._together(self.right, "1", "2", "3", "Enter", "Space", "Tab")

    def key_held(self) -> None:
        self._together(*[self.right] * 10)

    def enter_held(self) -> None:
        for _ in range(10):
            self.page.keyboard.down("Enter")
        self.page.keyboard.up("Enter")

    def space_held(self) -> None:
        for _ in range(10):
            self.page.keyboard.down("Space")
        self.page.keyboard.up("Space")

    def key_too_early(self) -> None:
        self.press(self.right)
        for _ in range(5):
            self.page.evaluate(EARLY)

    def key_as_the_trial_begins(self) -> None:
        self.press(self.right)
        self.page.wait_for_timeout(30)
        self.page.evaluate(EARLY)

    def keys_that_mean_nothing(self) -> None:
        for key in ("a", "0", "9", "F2", "Shift", "Delete", "PageDown", "ArrowUp", "é"):
            self.page.keyboard.press(key) if len(key) > 1 or key.isascii() else self.page.keyboard.insert_text(key)

    def key_with_control(self) -> None:
        for key in ("1", "2", "3"):
            self.press(f"Control+{key}")
            self.press(f"Alt+{key}")

    def escape(self) -> None:
        self.press("Escape")

    def escape_many_times(self) -> None:
        for _ in range(6):
            self.press("Escape")

    def escape_after_the_answer(self) -> None:
        self.press(self.right)
        self.press("Escape")

    def escape_and_enter_in_turn(self) -> None:
        for _ in range(4):
            self.press("Escape")
            self.press("Enter")

    def reload(self) -> None:
        self.page.reload()

    def reload_in_a_trial(self) -> None:
        self.press(self.right)
        self.page.wait_for_timeout(25)
        self.page.reload()

    def reload_at_the_answer(self) -> None:
        self.press(self.right)
        self.page.reload()

    def reload_three_times(self) -> None:
        for _ in range(3):
            self.page.reload()

    def back_and_forward(self) -> None:
        self.page.goto("about:blank")
        self.page.go_back()

    def back_at_the_answer(self) -> None:
        self.press(self.right)
        self.page.goto("about:blank")
        self.page.go_back()

    def second_tab(self) -> None:
        other = self.page.context.new_page()
        other.goto(self.page.url)
        other.locator("#go").wait_for()
        other.close()
        with self.page.expect_navigation():
            self.press("Enter")  # to continue here

    def second_tab_answers(self) -> None:
        other = self.page.context.new_page()
        other.on("websocket", lambda socket: socket.on("framereceived", self.subject._hear))
        other.goto(self.page.url)
        other.locator("#go").wait_for()
        other.keyboard.press("Enter")
        other.locator(ASKED).first.wait_for()
        stands = other.evaluate(STANDS)["trial"]
        self.press(self.subject.key(*map(int, stands.split("/"))))  # at the tab that was left
        other.keyboard.press(self.subject.key(*map(int, stands.split("/"))))
        other.close()
        with self.page.expect_navigation():
            self.press("Enter")  # to continue here

    def connection_lost(self) -> None:
        self.page.evaluate("link.socket?.close()")

    def connection_lost_before_the_answer(self) -> None:
        key = self.right
        self.page.evaluate("link.socket?.close()")
        self.press(key)

    def connection_lost_after_the_answer(self) -> None:
        self.press(self.right)
        self.page.evaluate("link.socket?.close()")

    def connection_lost_three_times(self) -> None:
        for _ in range(3):
            self.page.evaluate("link.socket?.close()")
            self.page.wait_for_timeout(600)

    def answer_that_is_not_sent(self) -> None:
        """The network takes nothing more, and says so later."""
        key = self.right
        self.page.evaluate(
            "() => { const lost = link.socket; lost.send = () => {}; setTimeout(() => lost.close(), 300); }"
        )
        self.press(key)

    def acknowledgement_that_does_not_come(self) -> None:
        key = self.right
        self.page.evaluate(
            "() => { const deaf = link.socket; deaf.onmessage = null; setTimeout(() => deaf.close(), 300); }"
        )
        self.press(key)

    def offline(self) -> None:
        self.page.context.set_offline(True)
        self.page.evaluate("link.socket?.close()")
        self.page.evaluate(EARLY)
        self.page.wait_for_timeout(1200)
        self.page.context.set_offline(False)

    def server_killed(self) -> None:
        self.server.kill()
        self.server.start()

    def server_killed_at_the_answer(self) -> None:
        self.press(self.right)
        self.server.kill()
        self.server.start()

    def leave_and_back(self) -> None:
        self.page.locator("#others button").last.click()
        self.page.locator("#others button").nth(2).click()

    def leave_keep_and_back(self) -> None:
        self.page.locator("#others button").last.click()
        self.page.locator("#others button").nth(2).wait_for()
        self.page.locator("#others button").first.click()
        self.press("Enter")  # the focus is on Back

    def double_click(self) -> None:
        key = self.right
        twice = "(choice) => { choice.click(); choice.click(); }"  # the next trial is not there yet
        self.page.locator(".choice").nth(int(key) - 1).evaluate(twice)

    def window_turned(self) -> None:
        self.page.set_viewport_size({"width": 640, "height": 360})
        self.page.set_viewport_size({"width": 360, "height": 640})
        self.press(self.right)

    def arrows_and_enter(self) -> None:
        key = self.right
        for _ in range(int(key)):
            self.press("ArrowRight")
        self.press("Enter")
        self.press("Enter")

    def another_window_in_front(self) -> None:
        other = self.page.context.new_page()
        other.goto("about:blank")
        other.keyboard.type("123")
        other.close()


MISHAPS = [name for name in vars(Mishaps) if not name.startswith("_") and name != "right"]


@pytest.mark.soak
def test_session__of_mishaps_at_the_keyboard_and_in_the_network__is_the_undisturbed_one(start, browser, tmp_path):
    assert len(MISHAPS) >= 30
    server = start(TEXT, controller())
    context = browser.new_context()
    page = context.new_page()
    errors = watch_errors(page)
    page.goto(server.addresses["subject S1"])
    subject = Subject(page, server.protocol)
    page.reload()
    mishaps, order = Mishaps(page, server, subject), random.Random(5).sample(MISHAPS, len(MISHAPS))
    for name in order:
        stands = len(subject.acknowledged) + 1
        while len(subject.acknowledged) < stands:
            assert subject.act(), f"the session was over before {name}"
        while not page.evaluate(STANDS)["trial"]:
            subject.act() if page.evaluate(STANDS)["go"] else page.wait_for_timeout(4)
        getattr(mishaps, name)()
    finish(subject, 300.0)
    rows = of_first(server.store)
    assert rows == undisturbed(tmp_path / "whole.db", TEXT)
    there = [(row[0], row[2]) for row in rows]
    assert len(set(there)) == len(there)
    assert {(run - 1, number) for run, number in subject.acknowledged} <= set(there)
    assert errors == []
    context.close()

"""The console's page in Chromium, for the tests of its views."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from tactuator.console import rig_connection
from tactuator.console.page_server import build_console
from tactuator.console.rig_process import RigProcess
from tactuator.console.state import ConsoleState
from tactuator.io.shipped import EXAMPLES
from tests.web.server import served

TOKEN = "a-token-of-this-test"
ONE = (EXAMPLES / "display.toml").read_text("utf-8").partition('[[channel]]\nname = "thumb"')[0]
"""A display of one channel."""
REFUSED = "Failed to load resource: the server responded with a status of 422"


_LEAVES = """(hash) => location.hash === hash || new Promise((done) => {
  addEventListener("hashchange", () => done(true), { once: true });
  location.hash = hash;
})"""
"""Ends when the page has begun to leave its view: the view before may be of the same name."""


def address_of(client: Any) -> str:
    return f"http://127.0.0.1:{client.port}/#token={TOKEN}"


@contextmanager
def console_with(state: ConsoleState, rig: str, display: Any, seed: int = 0) -> Iterator[Any]:
    """Yield a client of a console that holds a rig in a process of its own."""
    with closing(RigProcess(rig, display, seed)) as host, served(build_console(state, TOKEN, rig=host)) as client:
        client.host, client.state, client.folder = host, state, state.folder
        yield client


@contextmanager
def watched_page(browser: Any, timeout_s: float = 30.0, also_logged: bool = True) -> Iterator[Any]:
    """Yield an empty page; errors of its scripts, and those that the browser logged, fail the test at its end.

    The scope's pictures come twice a second: to draw them is most of what a browser does.
    """
    context = browser.new_context(accept_downloads=True, viewport={"width": 1366, "height": 900})
    page = context.new_page()
    page.set_default_timeout(1000.0 * timeout_s)
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    if also_logged:
        page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rig_connection, "FRAMES_HZ", 2.0)
        yield page
    assert [one for one in complaints if not one.startswith(REFUSED)] == []
    context.close()


@contextmanager
def opened_page(browser: Any, address: str, ready: str, timeout_s: float = 30.0) -> Iterator[Any]:
    with watched_page(browser, timeout_s) as page:
        page.goto(address)
        page.wait_for_selector(f"body[data-ready={ready}]")
        yield page


@contextmanager
def console_page(browser: Any, display: Path | None = None, rig: RigProcess | None = None) -> Iterator[Any]:
    """Yield the start page of a console; what the browser complains of fails the test at its end."""
    with (
        served(build_console(ConsoleState(display), TOKEN, rig=rig)) as client,
        opened_page(browser, address_of(client), "start", 120.0) as page,
    ):
        yield page


def go(page: Any, view: str, **more: str) -> None:
    given = "&".join(f"{name}={value}" for name, value in {"view": view, **more}.items())
    page.evaluate(_LEAVES, f"#{given}")
    page.wait_for_selector(f"body[data-ready={view}]")


def tab_to(page: Any, found: str, most: int = 120) -> None:
    for _ in range(most):
        page.keyboard.press("Tab")
        if page.evaluate("(wanted) => document.activeElement.matches(wanted)", found):
            return
    raise AssertionError(f"Tab does not reach {found}")


def pressed(page: Any, found: str, then: str = "") -> None:
    page.wait_for_selector(f"{found}:not([disabled])")
    tab_to(page, found)
    page.keyboard.press("Enter")
    if then:
        page.wait_for_selector(then)


def saved_by(page: Any, selector: str, path: Path) -> Path:
    with page.expect_download() as download:
        page.locator(selector).focus()
        page.keyboard.press("Enter")
    download.value.save_as(path)
    return path


def dropped(state: ConsoleState, path: Path, name: str | None = None) -> str:
    """Keep a copy of a file as if the page had uploaded it, and return its key."""
    key, folder = state.uploads.new_folder()
    (folder / (name or path.name)).write_bytes(path.read_bytes())
    state.uploads.keep(key, folder / (name or path.name))
    return key

"""Live sound in a real Chromium, by keyboard: started, seen, muted, ended by Escape; and another display's rig."""

import numpy as np
import pytest
import soundfile

from tactuator.console.state import ConsoleState
from tests.console.pages import ONE, address_of, console_with, go, opened_page, pressed, tab_to
from tests.console.test_rig_chromium import until

LEVEL = "Number(document.querySelector('[role=meter]').getAttribute('aria-valuenow'))"
DRAWN = """[...document.querySelectorAll('.live canvas')].map((one) => {
    const seen = one.getContext('2d').getImageData(one.width - 8, 8, 8, one.height - 14).data;
    return Math.max(...seen) - Math.min(...seen.filter((_, i) => i % 4 < 3));
})"""
"""How far the newest columns of each picture are from one colour."""
STARTED = """() => {
    document.querySelector("#live-start").click();
    return document.querySelector("#live-now").textContent;
}"""
"""Busy is shown before anything is waited for."""


@pytest.fixture
def console(tmp_path, monkeypatch):
    (path := tmp_path / "display.toml").write_text(ONE)
    time = np.arange(16000 * 60) / 16000
    soundfile.write(tmp_path / "long.wav", 0.3 * np.sin(2 * np.pi * 150 * time) * (time % 0.5 < 0.35), 16000)
    state = ConsoleState(path, tmp_path)
    monkeypatch.setattr(state.uploads, "path", lambda key: tmp_path / "long.wav")
    with console_with(state, "simulated", state.display("file"), 2) as client:
        yield client


@pytest.mark.slow
def test_live__by_keyboard__levels_and_spectra_are_shown_muted_and_ended_by_escape(browser, console):
    with opened_page(browser, f"{address_of(console)}&view=speech&display=file", "speech", 60.0) as page:
        page.wait_for_selector("#live-start:not([disabled])")
        assert page.evaluate(STARTED).startswith("Starting")
        page.wait_for_selector("#rig-mode:has-text('listening')")
        until(page, f"{LEVEL} > 20")
        page.wait_for_selector("#live-figures:has-text('drop-outs')")
        assert [name for name in page.locator(".live canvas").all() if not name.is_visible()] == []
        until(page, f"Math.min(...{DRAWN}) > 20")
        assert "--input long.wav --coding direct --level 35" in page.inner_text(".live code")
        pressed(page, "#live-mute", "#live-mute[aria-pressed=true]")
        until(page, f"{LEVEL} < 20")
        page.keyboard.press("Enter")
        page.wait_for_selector("#live-mute[aria-pressed=false]")
        until(page, f"{LEVEL} > 20")
        tab_to(page, "#live-level")
        page.keyboard.press("Escape")
        until(page, lambda: console.host.status.mode == "idle")
        until(page, f"{LEVEL} === -10")
        pressed(page, "#live-start", "#live-now:has-text('Escape ends it')")
        pressed(page, "#live-stop", "#live-start:not([disabled])")
        go(page, "speech", display="example:displays/tactuator.toml")
        page.wait_for_selector("#live-now:has-text('open that one to listen here')")
        assert page.locator("#live-start").is_disabled()

"""The view Experiment in a real Chromium, by keyboard alone: a study is begun, run, watched, exported and ended."""

import pytest

from tests.console.pages import address_of, opened_page, pressed, tab_to
from tests.console.test_accessibility_chromium import AXE, faults
from tests.experiment.session.apparatuses import PROTOCOL
from tests.web.labs import begun, until


@pytest.mark.slow
def test_experiment__by_keyboard_alone__is_begun_run_exported_and_ended(browser, console, tmp_path):
    bad, good = tmp_path / "bad.toml", tmp_path / "short.toml"
    bad.write_text(PROTOCOL.replace("seed = 7", "sed = 7"))
    good.write_text(PROTOCOL.replace("[30, 90, 210]", "[30, 90]"))
    with opened_page(browser, f"{address_of(console)}&view=experiment", "experiment") as page:
        page.set_input_files("#controller-file", console.file)
        page.wait_for_selector("#loaded:not(:has-text('none'))")
        tab_to(page, "#protocol-file")
        page.set_input_files("#protocol-file", good)
        page.wait_for_selector("#about-protocol:has-text('detection, language en, subjects S1, S2. no curve: ')")
        page.set_input_files("#protocol-file", bad)
        page.wait_for_selector(".drop .told:has-text('seed')")
        assert page.locator("#begin").is_disabled()
        page.set_input_files("#protocol-file", good)
        page.wait_for_selector("#about-protocol:has-text('“short”')")
        page.evaluate(AXE)
        assert faults(page, {}) == []
        pressed(page, "#begin", "#study:has-text('short')")
        pressed(page, "[data-start='S1']", "#state:has-text('running')")
        link = page.locator("#sessions a").first.get_attribute("href").removeprefix("/s/")
        with console.websocket_connect(f"/ws/subject/{link}") as subject:
            asked = begun(subject)
            subject.send_json({"type": "answer", "run": asked["run"], "number": asked["number"], "response": "2"})
            until(subject, "ack")
            page.wait_for_selector("#track circle")
        assert faults(page, {}) == []
        tab_to(page, "#export")
        with page.expect_download() as download:
            page.keyboard.press("Enter")
        assert download.value.suggested_filename == "tidy.zip"
        page.wait_for_selector("#exported:has-text('1 trials')")
        page.keyboard.press("Escape")  # the stop that is always there
        page.wait_for_selector("#state:has-text('nobody')")
        pressed(page, "#end-study", "#begin:not([disabled])")
        assert page.locator("#rig-held").inner_text() == "this page has the controls"

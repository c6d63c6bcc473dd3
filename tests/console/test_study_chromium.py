"""The view Experiment in a real Chromium, by keyboard alone: a study is begun, run, watched, exported and ended."""

import pytest

from tests.console.pages import address_of, opened_page, pressed, tab_to
from tests.console.test_accessibility_chromium import AXE, faults
from tests.experiment.session.apparatuses import PROTOCOL
from tests.web.study import ASKED, visible


@pytest.mark.slow
def test_experiment__by_keyboard_alone__is_begun_run_exported_and_ended(browser, console, tmp_path):
    bad, good = tmp_path / "bad.toml", tmp_path / "short.toml"
    bad.write_text(PROTOCOL.replace("seed = 7", "sed = 7"))
    good.write_text(PROTOCOL.replace("[30, 90, 210]", "[30, 90]"))
    with opened_page(browser, f"{address_of(console)}&view=experiment", "experiment") as page:
        page.wait_for_selector("#needs:has-text('needs a controller, loaded above and a protocol')")
        page.set_input_files("#controller-file", console.file)
        page.wait_for_selector("#needs:has-text('needs a protocol')")
        tab_to(page, "#protocol")
        page.keyboard.press("ArrowDown")  # a study of the package
        page.wait_for_selector("#about-protocol:has-text('subjects S1')")
        assert page.locator("#needs").inner_text() == ""
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
        tab_to(page, "#sessions a")
        with page.context.expect_page() as opened:
            page.keyboard.press("Enter")
        for text in ("Before we begin", "Which interval has the vibration"):
            visible(opened.value, text)
            opened.value.keyboard.press("Enter")
        opened.value.wait_for_selector(ASKED)
        opened.value.keyboard.press("1")
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

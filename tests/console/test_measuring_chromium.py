"""The response measured in Chromium, and the whole tour of a display: the files are those of the command line."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from tactuator.cli.main import main
from tactuator.console.state import FILE, ConsoleState
from tactuator.io.controller import read_controller, write_controller
from tactuator.io.reference import ReferenceHead, write_reference
from tactuator.rig.board.link import Mode
from tests.console.board_at_port import board_at_port
from tests.console.pages import ONE, address_of, console_with, go, saved_by, tab_to, watched_page
from tests.console.test_accessibility_chromium import AXE, faults

PROGRAM = "import sys; from tactuator.cli import main; sys.exit(main())"


@pytest.fixture
def page(browser):
    with watched_page(browser, 60.0, also_logged=False) as made:
        yield made


@pytest.fixture
def display(tmp_path):
    path = tmp_path / "display.toml"
    path.write_text(ONE.replace("[feedback]", "[environment]\nhum_hz = [50.0]\nhum_v_peak = [1e-3]\n[feedback]"))
    return path


def measured(page, frequencies, confidence_db="1"):
    """Ask for a measurement by keyboard."""
    page.locator("#frequencies").fill(frequencies)
    page.locator("#confidence").fill(confidence_db)
    tab_to(page, "#measure")
    page.keyboard.press("Enter")


def dragged(page, selector, up):
    """Drag a handle upwards by mouse."""
    page.locator(selector).first.scroll_into_view_if_needed()
    box = page.locator(selector).first.bounding_box()
    x, y = box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - up, steps=6)
    page.wait_for_timeout(100)
    page.mouse.up()


@pytest.mark.slow
def test_tour__record_identify_loop_save_measure_play__gives_the_files_of_the_command_line(page, display, tmp_path):
    state = ConsoleState(display)
    with console_with(state, "simulated", state.display(FILE)) as client:
        page.goto(f"{address_of(client)}&view=loop&display=file")
        shape_and_save(page, tmp_path)
        record_and_play(page, client.host, tmp_path)
        identify(page, tmp_path)
        measure(page, tmp_path)
        loaded = client.host.status.loaded
    saved = read_controller(tmp_path / "controller.json")
    assert saved.content_hash == loaded
    given = ["--frequency-hz", "40,100,250", "--confidence-db", "1", "--out", str(tmp_path / "theirs.csv"), "--json"]
    assert main(["measure", "--controller", str(tmp_path / "controller.json"), *given]) == 0
    assert (tmp_path / "response.csv").read_bytes() == (tmp_path / "theirs.csv").read_bytes()
    given = ["--order", "2", "--hold", "zero-order", "--out", str(tmp_path / "theirs.json"), "--json"]
    main(["identify", str(tmp_path / "index.csv"), *given])
    assert (tmp_path / "model.json").read_bytes() == (tmp_path / "theirs.json").read_bytes()


def shape_and_save(page, tmp_path):
    """Design a loop, drag a point of its curve, and save the controller."""
    page.wait_for_selector(".tiles[aria-busy=false]")
    page.locator("button.first").click()
    page.wait_for_selector("code:has-text('tactuator design')")
    page.wait_for_selector(".tiles[aria-busy=false]")
    before = page.url
    dragged(page, ".mark >> nth=3", 8.0)
    page.wait_for_url(lambda url: url != before)
    page.wait_for_selector(".tiles[aria-busy=false]")
    page.locator("text=Check and save").click()
    page.wait_for_selector("#save")
    saved_by(page, "#save", tmp_path / "controller.json")


def record_and_play(page, host, tmp_path):
    """Load the loop that was shaped, go live, record noise, and play a file."""
    page.locator("#to-scope").click()
    page.wait_for_selector("#use-loops:not([disabled])")
    page.locator("#use-loops").click()
    page.wait_for_selector("#live:not([disabled])")
    page.locator("#live").click()
    page.locator("#wave").select_option("noise")
    page.locator("#wave-level").fill("40")
    page.wait_for_selector("#play:not([disabled])")
    page.locator("#play").click()
    page.wait_for_selector("#wave-now:has-text('noise at 40 dB SL')")
    page.locator("#span").select_option("2")
    page.wait_for_timeout(2500)
    saved_by(page, "#save-record", tmp_path / "index.csv")
    rows = np.random.default_rng(2).uniform(-30.0, 30.0, (40000, 1))
    with write_reference(tmp_path / "speech.h5", ReferenceHead(4000.0, ("index",))) as writer:
        writer.write(rows)
    page.locator("#play:has-text('Silence')").click()
    page.wait_for_selector("#wave-now:has-text('silent')")
    page.locator("#wave").select_option("file")
    page.set_input_files("#wave-file", tmp_path / "speech.h5")
    page.wait_for_selector(".drop .name:has-text('speech.h5')")
    page.wait_for_timeout(300)  # the level is the file's own
    page.locator("#play").click()
    page.wait_for_selector("#wave-now:has-text('file at 29.5 dB SL on index')")
    page.wait_for_selector("#wave-now:has-text('silent')")
    played = host.samples.rows(0, host.samples.end)[:, 0]
    start = np.flatnonzero(played == np.float32(rows[0, 0]))[-1]
    np.testing.assert_array_equal(played[start : start + len(rows)], rows[:, 0].astype(np.float32))
    assert host.samples.lost == 0
    page.locator("#stop").click()
    page.wait_for_selector("#rig-mode:has-text('at rest')")


def identify(page, tmp_path):
    """Identify the record that the scope saved, with a form that is given."""
    page.locator("#to-identify").click()
    page.wait_for_selector("body[data-ready=identify]")
    text = (tmp_path / "index.csv").read_text()
    key = page.evaluate(
        """async (text) => (await (await fetch("/drop", { method: "POST", body: text,
        headers: { "x-token": sessionStorage.getItem("token"), "x-name": "index.csv" } })).json()).key""",
        text,
    )
    shapes = page.evaluate("new URLSearchParams(location.hash.slice(1)).get('shapes') ?? ''")
    go(page, "identify", record=key, name="index.csv", order="2", hold="zero-order", display="file", shapes=shapes)
    page.wait_for_selector("a[download='model.json']")
    saved_by(page, "a[download='model.json']", tmp_path / "model.json")


def measure(page, tmp_path):
    """Measure the response at three frequencies by keyboard, and save it."""
    page.locator("#to-response").click()
    page.wait_for_selector("#measure:not([disabled])")
    measured(page, "40,100,250")
    assert page.locator("#mains").input_value() == "50"
    page.wait_for_selector("#measured:has-text('3 points: measured')")
    page.evaluate(AXE)
    assert faults(page, {}) == []
    assert (
        "tactuator measure --controller controller.json --frequency-hz 40,100,250" in page.locator("code").inner_text()
    )
    for link, there in (("#to-loop", ".tiles[aria-busy=false]"), ("#to-response", "#measured:has-text('3 points')")):
        page.locator(link).click()  # it stays while another view is shown
        page.wait_for_selector(there)
    assert page.locator(".measured .factor input:not([type])").input_value().startswith("1: free, 30 dB SL, loops of")
    page.locator("#level").fill("")
    page.locator("#frequencies").fill("one, 10")
    page.locator("#measure").click()
    faulty = page.locator(".wrong").all_inner_texts()
    assert faulty == [
        "empty; allowed: -60 to 55",
        "“one” is no number above 0; allowed: frequencies in Hz, commas between",
    ]
    saved_by(page, "#save-response", tmp_path / "response.csv")


@pytest.mark.slow
def test_server__killed_in_mid_measurement__board_rests_page_says_so_and_its_points_can_be_saved(
    page, display, tmp_path
):
    from tactuator.io.display import read_display
    from tactuator.synthesis.design import design_controller

    write_controller(tmp_path / "controller.json", design_controller(read_display(display)))
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    with board_at_port() as board:
        command = [sys.executable, "-c", PROGRAM, "console", str(display), "--rig", f"board:{board.url}", "--port", "0"]
        server = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
        try:
            page.goto(server.stderr.readline().split()[1] + "&view=response")
            page.wait_for_selector("#controller-file")
            page.set_input_files("#controller-file", tmp_path / "controller.json")
            page.wait_for_selector("#measure:not([disabled])")
            measured(page, ",".join(str(hertz) for hertz in range(70, 110)), "0.02")
            page.wait_for_selector("#save-response:not([hidden])")
            assert board.transport.board.mode == Mode.RUNNING
            os.kill(server.pid, signal.SIGKILL)
            page.wait_for_selector("#banner:has-text('Its rig goes to rest by itself')")
            assert board.left.wait(timeout=30.0)
        finally:
            server.kill()
            server.wait()
            server.stderr.close()
        assert board.transport.board.mode == Mode.ARMED
        saved = saved_by(page, "#save-response", tmp_path / "response.csv").read_text()
    assert len(saved.splitlines()) >= 2
    assert saved.startswith("channel")

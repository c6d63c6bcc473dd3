"""The rig in a real Chromium, by keyboard alone: driven, touched, looked at, stopped; killed while it measures."""

import os
import signal
import socketserver
import subprocess
import sys
import threading
from contextlib import contextmanager, suppress
from types import SimpleNamespace

import pytest

from tactuator.io.controller import write_controller
from tactuator.io.record import read_record
from tactuator.rig.board.link import Mode
from tactuator.rig.transport import InProcess
from tests.console.pages import ONE, address_of, go, opened_page, pressed, saved_by, tab_to, watched_page
from tests.console.test_accessibility_chromium import AXE, faults
from tests.console.test_drags_chromium import ASLANT, NEAR_PX, pulled


def opened(browser, client):
    return opened_page(browser, f"{address_of(client)}&view=scope", "scope")


@pytest.fixture
def page(browser, console):
    with opened(browser, console) as made:
        yield made


def begun(page, console):
    page.set_input_files("#controller-file", console.file)
    page.wait_for_selector("#live:not([disabled])")
    page.locator("#live").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("#rig-mode:has-text('live')")


def until(page, reached):
    """Wait until a function or an expression of the page says so; its own policy lets no string be waited for in it."""
    for _ in range(300):
        if reached() if callable(reached) else page.evaluate(reached):
            return
        page.wait_for_timeout(50)
    raise AssertionError(reached)


def frames_past(page, count=3):
    before = page.evaluate("window.scopeFrames.length")
    until(page, f"window.scopeFrames.length >= {before + count}")


def still_but_for_the_cursor(page):
    for nth, (along, down) in enumerate(ASLANT):
        by, moved = pulled(page, f".cursor >> nth={nth}", along, down, lambda: frames_past(page, 1))
        assert (by, moved) == (pytest.approx((along, 0.0), abs=NEAR_PX), []), (nth, along, down)


@pytest.mark.slow
def test_scope__by_keyboard_alone__plays_is_touched_paused_saved_and_stopped(page, console, tmp_path):
    begun(page, console)
    tab_to(page, "#wave-level")
    page.keyboard.press("Control+a")
    page.keyboard.type("30")
    pressed(page, "#play", "#wave-now:has-text('tone at 30 dB SL on index, 100 Hz')")
    tab_to(page, "#touch-index")
    page.keyboard.press("ArrowDown")
    page.wait_for_selector("#levels small:has-text('at the tone')")
    until(page, "Math.abs(parseFloat(document.querySelector('#levels dd').textContent) - 30) < 2")
    assert console.host.status.touch["index"] == "finger"
    page.locator("#cursors").focus()
    page.keyboard.press("Enter")
    tab_to(page, ".cursor")
    page.keyboard.press("Shift+ArrowRight")
    page.wait_for_selector("#cursor-values:has-text('cursors: 70 ms apart')")
    still_but_for_the_cursor(page)
    page.locator("#pause").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("#pause:has-text('Go on')")
    traces = "document.querySelector('.traces canvas').clientHeight"
    usual = page.evaluate(traces)
    page.set_viewport_size({"width": 2560, "height": 1440})  # a display on a wall: it is drawn larger
    until(page, f"{traces} > 1.2 * {usual}")
    page.set_viewport_size({"width": 1366, "height": 900})
    page.evaluate(AXE)
    assert faults(page, {}) == []
    end = page.locator("#pause").get_attribute("data-row")
    with page.expect_download() as download:
        page.locator("#save-record").focus()
        page.keyboard.press("Enter")
    download.value.save_as(tmp_path / "index.csv")
    record = read_record(tmp_path / "index.csv")
    assert record.command.tolist() == pytest.approx(console.host.samples.rows(int(end) - 800, int(end))[:, 3].tolist())
    page.wait_for_selector("#play:has-text('Silence')")
    pressed(page, "#play", "#wave-now:has-text('silent')")
    until(page, "window.scopeLast.lost === 0")
    until(page, "document.querySelector('#levels small').textContent === 'sensor hum and noise'")
    page.locator("#pause").focus()
    page.keyboard.press("Enter")
    frames_past(page)
    page.keyboard.press("Escape")
    page.wait_for_selector("#rig-mode:has-text('at rest')")
    go(page, "display")  # a view without the rig stops it too, even where a field has the focus
    console.host.call("live")
    until(page, lambda: console.host.status.mode == "live")
    page.locator("#text").focus()
    page.keyboard.press("Escape")
    until(page, lambda: console.host.status.mode == "idle")


PROGRAM = "import sys; from tactuator.cli import main; sys.exit(main())"


@contextmanager
def board_at_port():
    """A board of this process behind a socket: its address, its transport, and an event while no client is there."""

    class Client(socketserver.BaseRequestHandler):
        def handle(self):
            board.gone.clear()  # a measurement opens the rig anew: the first client goes before it
            with suppress(OSError):
                while content := self.request.recv(1 << 16):
                    board.transport.send(content)
                    self.request.sendall(board.transport.receive(0.0))
            board.gone.set()

    with socketserver.TCPServer(("127.0.0.1", 0), Client) as server:
        url = f"socket://127.0.0.1:{server.server_address[1]}"
        board = SimpleNamespace(transport=InProcess(), gone=threading.Event(), url=url)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield board
        server.shutdown()


@pytest.mark.slow
def test_server__killed_in_mid_measurement__board_rests_and_points_can_be_saved(browser, tmp_path):
    from tactuator.io.display import read_display
    from tactuator.synthesis.design import design_controller

    (display := tmp_path / "display.toml").write_text(ONE)
    write_controller(tmp_path / "controller.json", design_controller(read_display(display)))
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    with board_at_port() as board, watched_page(browser, 60.0, also_logged=False) as page:
        command = [sys.executable, "-c", PROGRAM, "console", str(display), "--rig", f"board:{board.url}", "--port", "0"]
        server = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
        try:
            page.goto(server.stderr.readline().split()[1] + "&view=response")
            page.wait_for_selector("#controller-file")
            page.set_input_files("#controller-file", tmp_path / "controller.json")
            page.wait_for_selector("#measure:not([disabled])")
            page.locator("#frequencies").fill(",".join(str(hertz) for hertz in range(70, 270)))
            page.locator("#confidence").fill("0.005")  # 200 points: a minute of work, so that a slow page is in time
            pressed(page, "#measure", "#save-response:not([hidden])")
            until(page, lambda: board.transport.board.mode == Mode.RUNNING)  # between two points it is armed
            os.kill(server.pid, signal.SIGKILL)
            page.wait_for_selector("#banner:has-text('Its rig goes to rest by itself')")
            assert board.gone.wait(timeout=30.0)
        finally:
            server.kill()
            server.wait()
            server.stderr.close()
        assert board.transport.board.mode == Mode.ARMED
        saved = saved_by(page, "#save-response", tmp_path / "response.csv").read_text()
    assert len(saved.splitlines()) >= 2
    assert saved.startswith("channel")

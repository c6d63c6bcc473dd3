"""A server that is killed while the page measures: the board rests, and what was measured can be saved."""

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
from tactuator.rig.board.link import Mode
from tactuator.rig.transport import InProcess
from tests.console.pages import ONE, pressed, saved_by, watched_page

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
def test_server__killed_in_mid_measurement__board_rests_page_says_so_and_its_points_can_be_saved(browser, tmp_path):
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
            page.locator("#frequencies").fill(",".join(str(hertz) for hertz in range(70, 110)))
            page.locator("#confidence").fill("0.02")
            pressed(page, "#measure", "#save-response:not([hidden])")
            assert board.transport.board.mode == Mode.RUNNING
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

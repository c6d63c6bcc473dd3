"""A program that plays live sound on a board is killed: when command and displacement have come to rest.

`tactuator listen` runs as a user runs it, over a socket, on a board in this process whose time goes on: the core's
board with its simulated display, one period at each 0.25 ms of the wall clock. Every period's command at the motors
and displacement at the finger ports is kept, with the time; the kill (SIGKILL) comes while the command is at a third
of its greatest or more; with `--ctrl-c` it is SIGINT, with `--lost` the board's link that ends. Run: python -m
witnesses.live.killed CONTROLLER SOUND [TIMES], at real-time priority (chrt -r 2) on a busy machine. Seen to fail: a
board to which nothing is silence (`--hears`).
"""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

import tactuator as tt
from tactuator.rig.board.link import LinkClient
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.transport import InProcess
from tactuator.runtime._core import ffi, lib
from witnesses.live.limits import FloatArray, felt_of

RATE, CHANNELS, WATCHED_S, PROMISED_S = 4000, 3, 1.5, 0.3
COMFORT_DB, STILL_DB, HEARD_V = 55.0, 6.0, 0.1


class Board:
    """A board behind a socket; rows: time, commands and displacements of every period."""

    def __init__(self, display: Any, hears: bool) -> None:
        self._inside = InProcess()
        BoardRig(LinkClient(self._inside), display).simulate(1)
        self._inside.board.allows_hold = 0
        self._hears = hears
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self.rows: list[tuple[float, ...]] = []
        self.ends = self.lost = False
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        taken, _ = self._server.accept()
        taken.setblocking(False)
        answer, states = ffi.new("uint8_t[]", 1 << 16), [self._inside.simulated.state[k] for k in range(CHANNELS)]
        began_s, ticks = time.monotonic(), 0
        while not self.ends:
            if self.lost:
                taken.close()
            try:
                content = taken.recv(1 << 16)
            except OSError:  # nothing has come, or the other end has gone
                content = b""
            if content:
                size = lib.tact_link_serve(self._inside.link, content, len(content), answer, 1 << 16)
                taken.sendall(bytes(ffi.buffer(answer, size)))
            for _ in range(int((time.monotonic() - began_s) * RATE) - ticks):
                if self._hears:
                    self._inside.board.silence = 0
                lib.tact_simulated_board_period(self._inside.simulated, self._inside.board, 0)
                ticks += 1
                moved = [each.displacement_mm for each in states]
                self.rows.append((began_s + ticks / RATE, *(each.motor_v for each in states), *moved))
            time.sleep(0.0002)

    def close(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        self.ends = True
        self._thread.join()
        self._server.close()
        return np.array(self.rows)


def killed(controller_path: Path, sound: Path, seconds: float, hears: bool) -> tuple[float, float, float, float]:
    """Seconds from the kill to the last command, to the last that is felt; the levels before and after it, dB SL."""
    board = Board(tt.read_controller(controller_path).display, hears)
    words = [
        str(Path(sys.executable).with_name("tactuator")), "listen", "--rig", f"board:socket://127.0.0.1:{board.port}",
        "--controller", str(controller_path), "--input", str(sound), "--gain", "70", "--gate", "0",
    ]  # fmt: skip
    program = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=sys.stderr)
    end = time.monotonic() + 60.0
    while time.monotonic() < end and not any(abs(row[1]) > HEARD_V for row in board.rows[-40:]):
        time.sleep(0.05)
    time.sleep(seconds)
    if program.poll() is not None:
        board.close()
        raise AssertionError("nothing was played: on so busy a machine the board's stream runs dry")
    most = max(abs(row[1]) for row in board.rows)
    while abs(board.rows[-1][1]) < most / 3.0 and time.monotonic() < end:
        time.sleep(0.0001)
    if "--lost" in sys.argv:
        board.lost = True
    else:
        os.kill(program.pid, signal.SIGINT if "--ctrl-c" in sys.argv else signal.SIGKILL)
    at_s = time.monotonic()
    program.wait()
    time.sleep(WATCHED_S)
    rows = board.close()
    after = rows[:, 0] - at_s
    felt: FloatArray = np.stack([np.abs(felt_of(rows[:, k] - rows[-1, k], RATE)) for k in (4, 5, 6)], axis=1)
    command = np.abs(rows[:, 1:4]).max(axis=1)
    still = 10.0 ** (STILL_DB / 20.0)
    levels = [20 * np.log10(felt[chosen].max()) for chosen in ((after < 0.0) & (after > -0.5), after > 0.0)]
    last = [float(after[met].max(initial=0.0)) for met in (command > 0.0, felt.max(axis=1) > still)]
    return last[0], last[1], float(levels[0]), float(levels[1])


def main() -> int:
    asked = [each for each in sys.argv[1:] if not each.startswith("--")]
    times, worst = int(asked[2]) if len(asked) > 2 else 5, 0.0
    for number in range(times):
        found = killed(Path(asked[0]), Path(asked[1]), 1.0 + 0.37 * number, "--hears" in sys.argv)
        command_s, felt_s, before_db, after_db = found
        print(
            f"command ends {1e3 * command_s:.0f} ms after it, felt until {1e3 * felt_s:.0f} ms; "
            f"felt before {before_db:.1f} dB SL, after at most {after_db:.1f} dB SL", flush=True,
        )  # fmt: skip
        worst = max(worst, command_s, 0.0 if after_db <= COMFORT_DB else np.inf, 0.0 if before_db > 20.0 else np.inf)
    return int(worst > PROMISED_S)


if __name__ == "__main__":
    sys.exit(main())

"""A sound card without hardware: a JACK server of our own with wires on it, for the length of a context.

`python -m tests.rig.sound.simulated_card SERVER NAME COUNT` is the wires' program, a client of the server: the ports of
a client are a device for PortAudio.
"""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tactuator.rig.sound.cards import leave_library

ROOT = Path(__file__).parents[3]
RATE_HZ = 48000.0
START_S = 120.0
"""A server has to be there within so long."""
PERIOD = 4096
PRIORITY = 20
_SERVERS = 6


@contextmanager
def simulated_card(count: int, period: int = PERIOD) -> Iterator[subprocess.Popen[bytes]]:
    """Yield the server of a sound card with a wire from each output to its input; both programs are ended at the end of
    the context.

    The server is this process's default one meanwhile: PortAudio must not have been asked for before.
    """
    assert "sounddevice" not in sys.modules, "PortAudio has looked for its servers before"
    with _server_name() as (name, lock):
        os.environ |= {"JACK_DEFAULT_SERVER": name, "JACK_NO_AUDIO_RESERVATION": "1", "JACK_NO_START_SERVER": "1"}
        dummy = ["-d", "dummy", "-r", f"{RATE_HZ:g}", "-p", str(period), "-w", str(round(1e6 * period / RATE_HZ))]
        server = subprocess.Popen(
            ["jackd", "-n", name, *_schedule(), "-m", "-T", "-t", "5000", *dummy, "-C", "2", "-P", "2"],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, pass_fds=[lock],
        )  # fmt: skip
        client: subprocess.Popen[bytes] | None = None
        try:
            client = _started_client(name, f"{name}-wires", str(count))
            yield server
        finally:
            leave_library()
            for process in (client, server):
                _end(process)


@contextmanager
def _server_name() -> Iterator[tuple[str, int]]:
    """Yield a name that no other program of ours holds, and the file that locks it: a server that inherits it holds the
    name until it has ended, also where the program that began it was killed.

    JACK has room for eight servers, and a name that died with its server is freed only by the next server of that name:
    so the same few names are used again and again.
    """
    for number in range(1, _SERVERS + 1):
        with (Path(tempfile.gettempdir()) / f"tactuator-jack-{os.getuid()}-{number}.lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield f"tactuator-{number}", lock.fileno()
            return
    raise AssertionError(f"{_SERVERS} simulated sound cards run already")


def _schedule() -> list[str]:
    """Return the server's options for realtime priority where this program may ask for it: then neither the server nor
    the wires are late on a machine that has much to do.
    """
    allowed: list[bool] = []

    def ask() -> None:  # in a thread that ends: the priority is the thread's own
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        except (AttributeError, OSError):
            return
        allowed.append(True)

    asking = threading.Thread(target=ask)
    asking.start()
    asking.join()
    return ["-R", "-P", str(PRIORITY)] if allowed else ["-r"]


def _started_client(*arguments: str) -> subprocess.Popen[bytes]:
    client = subprocess.Popen(
        [sys.executable, "-m", "tests.rig.sound.simulated_card", *arguments],
        cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert client.stdout is not None
    late = threading.Timer(2.0 * START_S, client.kill)
    late.start()
    ready = client.stdout.readline() == b"ready\n"
    late.cancel()
    if ready:
        return client
    raise AssertionError(f"the JACK server did not start: {_end(client)[-2000:]!r}")


def _end(process: subprocess.Popen[bytes] | None) -> bytes:
    """End a process that we began, and return what it wrote to standard error."""
    if process is None:
        return b""
    process.terminate()
    try:
        return process.communicate(timeout=5.0)[1] or b""
    except subprocess.TimeoutExpired:
        process.kill()
        return process.communicate()[1] or b""


def main(arguments: Sequence[str]) -> None:
    """Run until the server ends or standard input is closed."""
    import jack

    server, name, count = arguments
    jack.set_error_function(lambda text: None)
    client = opened(jack, name, server)
    wires = [(client.inports.register(f"in_{k}"), client.outports.register(f"out_{k}")) for k in range(int(count))]
    over = threading.Event()

    @client.set_process_callback  # type: ignore[untyped-decorator]
    def process(frames: int) -> None:
        for taken, given in wires:
            given.get_array()[:] = taken.get_array()

    @client.set_shutdown_callback  # type: ignore[untyped-decorator]
    def shutdown(status: object, reason: str) -> None:
        over.set()

    def wait_for_end() -> None:  # of whoever began it
        sys.stdin.read()
        over.set()

    with client:
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        threading.Thread(target=wait_for_end, daemon=True).start()
        over.wait()


def opened(jack: Any, name: str, server: str) -> Any:
    """Return a client of that name on a server that may still be starting; JACK's own error after START_S."""
    until = time.monotonic() + START_S
    while True:
        try:
            return jack.Client(name, servername=server, no_start_server=True)
        except jack.JackError:
            if time.monotonic() > until:
                raise
            time.sleep(0.1)


if __name__ == "__main__":
    main(sys.argv[1:])

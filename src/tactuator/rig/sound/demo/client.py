"""The program of simulated exciters on a JACK server: `python -m tactuator.rig.sound.demo.client SETTINGS.json`.

Each exciter has a port that drives it, one of its accelerometer and one that tells its displacement: the ports
of a client are a device for PortAudio. An exciter that is null is a wire.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.rig.sound.demo.exciter import Exciter, RunningExciter

START_S = 20.0
"""A server has to be there within so long."""

Answer = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def main(arguments: Sequence[str]) -> None:
    """Run until the server ends or standard input is closed."""
    import jack  # noqa: PLC0415 - an extra, which only the simulated card needs

    settings: dict[str, Any] = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
    jack.set_error_function(lambda text: None)
    client = opened(jack, settings["client"], settings["server"])
    rng = np.random.default_rng(settings["seed"])
    answers = [answer_of(one, float(client.samplerate), rng) for one in settings["exciters"]]
    count = len(answers)
    drives = [client.inports.register(f"drive_{k + 1}") for k in range(count)]
    ports = [client.outports.register(f"sensor_{k + 1}") for k in range(count)]
    ports += [client.outports.register(f"felt_{k + 1}") for k in range(count)]
    over = threading.Event()

    @client.set_process_callback  # type: ignore[untyped-decorator]
    def process(frames: int) -> None:
        for k, answer in enumerate(answers):
            heard, moved = answer(drives[k].get_array().astype(np.float64))
            ports[k].get_array()[:] = heard
            ports[count + k].get_array()[:] = moved

    @client.set_shutdown_callback  # type: ignore[untyped-decorator]
    def shutdown(status: object, reason: str) -> None:
        over.set()

    with client:
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        threading.Thread(target=_wait_for_end, args=(over,), daemon=True).start()
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


def _wait_for_end(over: threading.Event) -> None:
    """End the program where whoever began it is gone."""
    sys.stdin.read()
    over.set()


def answer_of(settings: dict[str, Any] | None, rate_hz: float, rng: np.random.Generator) -> Answer:
    """Return what answers samples of command with those of sensor and displacement: an exciter, or a wire for None."""
    if settings is None:
        return lambda share: (share, share)
    return RunningExciter(Exciter(**settings), rate_hz, rng).answer


if __name__ == "__main__":
    main(sys.argv[1:])

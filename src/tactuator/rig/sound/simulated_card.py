"""A sound card without hardware: a JACK server of our own with simulated exciters on it, for the length of a context.

`python -m tactuator.rig.sound.simulated_card SETTINGS.json` is the exciters' program, a client of the server. Each has
a port that drives it, one of its accelerometer and one that tells its displacement: the ports of a client are a device
for PortAudio. An exciter that is null is a wire. An exciter is a high-pass, a delay, modes, a hardening spring and a
noisy accelerometer; one is drawn at random for a demonstration, with its display.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput, DeviceFault
from tactuator.io.display import parse_display
from tactuator.model.description import Display
from tactuator.rig.sound.cards import leave_library
from tactuator.runtime._core import ffi, lib

SUBSTEPS = 8
RATE_HZ = 48000.0


@dataclass(frozen=True)
class Exciter:
    """An exciter with its amplifier and accelerometer. resonance_hz, q: of the first mode; second_hz, second_q,
    second_share: of another, and its share of the drive.

    drive: mm/s² for a volt. hardening: 1/mm², of the first spring. delay_s: from the card's output to the coil.
    high_pass_hz: the card's own, first order. volts, sensor_full_scale: volts at the coil, and mm/s² at the
    accelerometer, for a sample of 1.0. noise, hum: mm/s² rms of white noise, peak at hum_hz. felt_full_scale_mm: of the
    port that tells the displacement itself.
    """

    resonance_hz: float = 110.0
    q: float = 5.0
    drive: float = 2.0e4
    second_hz: float = 420.0
    second_q: float = 8.0
    second_share: float = 0.1
    hardening: float = 0.0
    delay_s: float = 0.004
    high_pass_hz: float = 8.0
    volts: float = 2.0
    sensor_full_scale: float = 5.0e4
    noise: float = 20.0
    hum: float = 5.0
    hum_hz: float = 50.0
    felt_full_scale_mm: float = 2.0

    def response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return mm at the finger for a volt asked of the card, at `frequency_hz` (any shape), for small amplitudes and
        in continuous time: the truth that the simulation is held against.
        """
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        moved = np.zeros(s.shape, dtype=np.complex128)
        for hertz, q, drive in self._modes():
            w = 2.0 * np.pi * hertz
            moved += drive / (s * s + s * w / q + w * w)
        corner = 2.0 * np.pi * self.high_pass_hz
        return np.asarray(moved * s / (s + corner) * np.exp(-s * self.delay_s))

    def _modes(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        first = (self.resonance_hz, self.q, self.drive * (1.0 - self.second_share))
        return first, (self.second_hz, self.second_q, self.drive * self.second_share)


class RunningExciter:
    """An exciter at rest that is fed block after block at rate_hz."""

    def __init__(self, exciter: Exciter, rate_hz: float, rng: np.random.Generator) -> None:
        self._exciter, self._rate_hz, self._rng = exciter, rate_hz, rng
        self._state = ffi.new("tact_exciter *")
        self._state.step_s, self._state.substeps = 1.0 / (rate_hz * SUBSTEPS), SUBSTEPS
        for mode, (hertz, q, drive) in zip(self._state.mode, exciter._modes(), strict=True):
            w = 2.0 * np.pi * hertz
            mode.drive, mode.damping, mode.stiffness = drive, w / q, w * w
        self._state.mode[0].hardening = exciter.hardening
        self._high_pass = scipy.signal.butter(1, exciter.high_pass_hz, "highpass", fs=rate_hz)
        self._passed = np.zeros(1)
        self._late = np.zeros(round(exciter.delay_s * rate_hz))
        self._samples = 0

    def answer(self, share: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the samples of the accelerometer and of the displacement, (n,), for samples of command (n,)."""
        exciter = self._exciter
        passed, self._passed = scipy.signal.lfilter(*self._high_pass, exciter.volts * share, zi=self._passed)
        waiting = np.concatenate([self._late, passed])
        command, self._late = np.ascontiguousarray(waiting[: share.size]), waiting[share.size :]
        acceleration, moved = np.empty(share.size), np.empty(share.size)
        buffers = [ffi.from_buffer("double[]", array) for array in (command, acceleration, moved)]
        lib.tact_exciter_run(self._state, *buffers, share.size)
        time = (self._samples + np.arange(share.size)) / self._rate_hz
        self._samples += share.size
        noise = exciter.noise * self._rng.standard_normal(share.size)
        heard = acceleration + noise + exciter.hum * np.sin(2.0 * np.pi * exciter.hum_hz * time)
        return np.clip(heard / exciter.sensor_full_scale, -1.0, 1.0), np.clip(
            moved / exciter.felt_full_scale_mm, -1.0, 1.0
        )


def demo_exciter(rng: np.random.Generator) -> Exciter:
    """Return an exciter as one can buy: resonance 60 to 150 Hz, Q 2 to 8, a second mode, delay and high-pass."""
    resonance_hz = float(rng.uniform(60.0, 150.0))
    return Exciter(
        resonance_hz=resonance_hz,
        q=float(rng.uniform(2.0, 8.0)),
        drive=3e4,
        second_hz=resonance_hz * float(rng.uniform(2.0, 4.0)),
        hardening=0.2,
        delay_s=float(rng.uniform(0.002, 0.02)),
        sensor_full_scale=1e5,
    )


def demo_display(exciter: Exciter) -> Display:
    """Return its display, whose plant is a rough guess: the calibration finds it anew."""
    document = {
        "display": {"name": "simulated exciter", "rate_hz": RATE_HZ, "delay_samples": 0},
        "threshold": {"curve": "bolanowski-1988", "band_hz": [10.0, 400.0]},
        "feedback": {"structure": "none"},
        "converter": {"range_v": exciter.volts},
        "sound": {
            "output_full_scale_v": exciter.volts,
            "input_full_scale_v": 1e-3 * exciter.sensor_full_scale,
            "lead_s": 0.5,
        },
        "channel": [
            {
                "name": "exciter",
                "sensor_gain_v_per_mm": 1e-3,
                "quantity": "acceleration",
                "travel_mm": 1.0,
                "plant": {"num": [1.0], "den": [1.0, 100.0, 1e6]},
            }
        ],
    }
    return parse_display(document)


START_S = 20.0
"""A server has to be there within so long."""
PERIOD = 4096
PRIORITY = 20
_SERVERS = 6


@dataclass
class SimulatedCard:
    """A running server with its client. name: the server's; device: what PortAudio calls the exciters."""

    name: str
    device: str
    server: subprocess.Popen[bytes]
    client: subprocess.Popen[bytes]


@contextmanager
def simulated_card(exciters: Sequence[Exciter | None], period: int = PERIOD, seed: int = 0) -> Iterator[SimulatedCard]:
    """Yield a sound card with an exciter (None: a wire) between each output and input; both programs are ended at the
    end of the context.

    The server is this process's default one meanwhile: PortAudio must not have been asked for before. Raises BadInput
    where JACK is missing, DeviceFault where it does not start.
    """
    if shutil.which("jackd") is None:
        raise BadInput("the simulated sound card needs jackd", "where it is installed (apt-get install jackd2)")
    if "sounddevice" in sys.modules:
        raise BadInput("PortAudio has looked for its servers before", "the simulated card in a fresh program")
    documents = [None if exciter is None else asdict(exciter) for exciter in exciters]
    with _server_name() as (name, lock), tempfile.TemporaryDirectory() as folder:
        os.environ |= {"JACK_DEFAULT_SERVER": name, "JACK_NO_AUDIO_RESERVATION": "1", "JACK_NO_START_SERVER": "1"}
        file, device = Path(folder) / "exciters.json", f"{name}-exciters"
        settings = {"server": name, "client": device, "seed": seed, "exciters": documents}
        file.write_text(json.dumps(settings), encoding="utf-8")
        dummy = ["-d", "dummy", "-r", f"{RATE_HZ:g}", "-p", str(period), "-w", str(round(1e6 * period / RATE_HZ))]
        server = subprocess.Popen(
            ["jackd", "-n", name, *_schedule(), "-m", "-T", "-t", "5000", *dummy, "-C", "2", "-P", "2"],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, pass_fds=[lock],
        )  # fmt: skip
        client: subprocess.Popen[bytes] | None = None
        try:
            client = _started_client(file)
            yield SimulatedCard(name, device, server, client)
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
    raise DeviceFault(f"{_SERVERS} simulated sound cards run already", "no more at once")


def _schedule() -> list[str]:
    """Return the server's options for realtime priority where this program may ask for it: then neither the server nor
    the exciters are late on a machine that has much to do.
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


def _started_client(settings: Path) -> subprocess.Popen[bytes]:
    client = subprocess.Popen(
        [sys.executable, "-m", "tactuator.rig.sound.simulated_card", str(settings)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert client.stdout is not None
    late = threading.Timer(2.0 * START_S, client.kill)
    late.start()
    ready = client.stdout.readline() == b"ready\n"
    late.cancel()
    if ready:
        return client
    words = _end(client)
    if b"No module named 'jack'" in words:
        raise BadInput("the simulated sound card needs JACK-Client", "pip install 'tactuator[sound]'")
    raise DeviceFault("the JACK server did not start", "a machine on which `jackd -d dummy` runs")


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
    import jack  # noqa: PLC0415 - an extra, which only the simulated card needs

    settings: dict[str, Any] = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
    jack.set_error_function(lambda text: None)
    client = opened(jack, settings["client"], settings["server"])
    rng = np.random.default_rng(settings["seed"])
    running = [
        None if exciter is None else RunningExciter(Exciter(**exciter), float(client.samplerate), rng)
        for exciter in settings["exciters"]
    ]
    count = len(running)
    drives = [client.inports.register(f"drive_{k + 1}") for k in range(count)]
    ports = [client.outports.register(f"sensor_{k + 1}") for k in range(count)]
    ports += [client.outports.register(f"felt_{k + 1}") for k in range(count)]
    over = threading.Event()

    @client.set_process_callback  # type: ignore[untyped-decorator]
    def process(frames: int) -> None:
        for k, exciter in enumerate(running):
            share = drives[k].get_array().astype(np.float64)
            heard, moved = (share, share) if exciter is None else exciter.answer(share)
            ports[k].get_array()[:] = heard
            ports[count + k].get_array()[:] = moved

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

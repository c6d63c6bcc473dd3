"""Programs that tests run in processes of their own, each with a simulated card."""

import os
import signal
import threading
import time

import numpy as np

from tactuator.errors import DeviceFault
from tactuator.rig.open import open_rig
from tactuator.rig.rig import Rig
from tactuator.rig.sound.stream import SoundGap
from tests.rig.sound.exciter import Exciter
from tests.rig.sound.simulated_card import simulated_card
from tests.rig.sound.turned_card import sound_display

RATE_HZ = 48000.0
QUIET = {"noise": 0.0, "hum": 0.0}
PROVOKED = 3


def opened(count: int, **sound: float) -> Rig:
    display = sound_display([f"c{k + 1}" for k in range(count)], RATE_HZ, 2.0, input_full_scale_v=2.0, **sound)
    return open_rig("sound:-exciters", display)


def delay_of(asked: np.ndarray, heard: np.ndarray) -> int:
    size = 2 * asked.size
    cross = np.fft.irfft(np.fft.rfft(heard, size) * np.conj(np.fft.rfft(asked, size)))
    return int(np.argmax(cross[: asked.size]))


def exciter_and_wires() -> dict[str, object]:
    """A linear exciter and three wires on one card: the loopback of the wires, and the exciter's response."""
    exciter = Exciter(q=12.0, felt_full_scale_mm=2.0, **QUIET)
    with simulated_card([exciter, None, None, None]), opened(4) as rig:
        return _loopback(rig) | _multisine_against_truth(rig, exciter)


def _loopback(rig: Rig) -> dict[str, object]:
    delays, exact = [], []
    for seed in (1, 2):
        trace = rig.drive(np.random.default_rng(seed).uniform(-1.9, 1.9, (96000, 4)) * [0.0, 1.0, 1.0, 1.0])
        for column in (1, 2, 3):
            asked, heard = trace.command_v[:, column], trace.position_v[:, column]
            late = delay_of(asked, heard)
            delays.append(late)
            exact.append(np.array_equal((asked[:-late] / 2.0).astype(np.float32) * 2.0, heard[late:]))
    return {"delays": delays, "exact": exact}


def _multisine_against_truth(rig: Rig, exciter: Exciter) -> dict[str, object]:
    period, lines = 96000, np.arange(16, 1200, 26)
    spectrum = np.zeros(period // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(2j * np.pi * np.random.default_rng(1).uniform(size=lines.size))
    wave = np.fft.irfft(spectrum, period)
    wave *= 0.5 / np.max(np.abs(wave))
    trace = rig.drive(np.column_stack([np.tile(wave, 3)] * 4))
    late = delay_of(trace.command_v[:, 1], trace.position_v[:, 1])
    heard = np.fft.rfft(trace.position_v[-period:, 0])[lines] / np.fft.rfft(wave)[lines]
    frequency = lines * RATE_HZ / period
    s = 2j * np.pi * frequency
    # the accelerometer's volts for 1.0 are 2 V at the card; its mean over a sample is told a sample late
    scale = 2.0 / exciter.sensor_full_scale
    truth = scale * s**2 * exciter.response(frequency) * np.exp(-s * late / RATE_HZ)
    ratio = heard / truth
    worst = np.argmax(np.abs(np.log(np.abs(ratio))))
    worst_db = float(abs(20.0 * np.log10(abs(ratio[worst]))))
    return {"worst_db": worst_db, "worst_deg": float(np.max(np.abs(np.degrees(np.angle(ratio)))))}


def server_killed() -> dict[str, object]:
    with simulated_card([None]) as card, opened(1) as rig:
        threading.Timer(1.0, card.server.kill).start()
        try:
            rig.drive(np.zeros((480000, 1)))
        except DeviceFault as fault:
            return {"fault": type(fault).__name__, "words": str(fault)}
    return {"fault": "none"}


def client_stopped() -> dict[str, object]:
    """The exciter's program is stopped for half a second, again and again; the card has to tell."""
    told = 0
    with simulated_card([None]) as card, opened(1) as rig:

        def stop() -> None:
            os.kill(card.client.pid, signal.SIGSTOP)
            time.sleep(0.5)
            os.kill(card.client.pid, signal.SIGCONT)

        for _ in range(PROVOKED):
            timer = threading.Timer(0.3, stop)
            timer.start()
            try:
                for _ in rig._begin(rig._driven(np.zeros((72000, 1)))):
                    pass
            except SoundGap:
                told += 1
            timer.join()
            time.sleep(0.5)
    return {"told": told, "provoked": PROVOKED}

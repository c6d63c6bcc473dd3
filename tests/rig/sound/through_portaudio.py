"""Programs that tests run in processes of their own, each with a simulated card."""

import threading

import numpy as np

from tactuator.errors import DeviceFault
from tactuator.rig.open import open_rig
from tactuator.rig.rig import Rig
from tests.rig.sound.simulated_card import simulated_card
from tests.rig.sound.turned_card import sound_display

RATE_HZ = 48000.0


def opened(count: int) -> Rig:
    display = sound_display([f"c{k + 1}" for k in range(count)], RATE_HZ, 2.0, input_full_scale_v=2.0)
    return open_rig("sound:-wires", display)


def loopback() -> dict[str, object]:
    delays, exact = [], []
    with simulated_card(3), opened(3) as rig:
        for seed in (1, 2):
            trace = rig.drive(np.random.default_rng(seed).uniform(-1.9, 1.9, (96000, 3)))
            for asked, heard in zip(trace.command_v.T, trace.position_v.T, strict=True):
                cross = np.fft.irfft(np.fft.rfft(heard, 192000) * np.conj(np.fft.rfft(asked, 192000)))
                late = int(np.argmax(cross[:96000]))
                delays.append(late)
                exact.append(np.array_equal((asked[:-late] / 2.0).astype(np.float32) * 2.0, heard[late:]))
    return {"delays": delays, "exact": exact}


def server_killed() -> dict[str, object]:
    with simulated_card(1) as server, opened(1) as rig:
        threading.Timer(1.0, server.kill).start()
        try:
            rig.drive(np.zeros((480000, 1)))
        except DeviceFault as fault:
            return {"fault": type(fault).__name__, "words": str(fault)}
    return {"fault": "none"}

"""A second back end by hand: PulseAudio's null sink and its monitor, reached by ALSA's plugin: JSON.

    python -m tests.rig.sound.through_pulseaudio

The null sink is a wire without an actuator: what is heard of its monitor must be what was put out.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tactuator.rig.open import open_rig
from tactuator.rig.sound.cards import list_cards
from tactuator.rig.sound.rig import SoundRig
from tests.rig.sound.through_portaudio import delay_of, display

SINK = "module-null-sink sink_name=exciter channels=2 channel_map=front-left,front-right rate=48000 format=float32le"
CARD = 'pcm.{name} {{ type pulse server "unix:{socket}" device "{device}" hint {{ show on description "{name}" }} }}\n'


def run() -> dict[str, object]:
    """Play noise into the sink and hear it from the monitor."""
    with tempfile.TemporaryDirectory() as folder:
        socket = f"{folder}/native"
        server = subprocess.Popen(
            ["pulseaudio", "-n", "--daemonize=no", "--exit-idle-time=-1", "--use-pid-file=no", "--disable-shm=yes",
             "-L", SINK, "-L", f"module-native-protocol-unix auth-anonymous=1 socket={socket}"],
            env=os.environ | {"HOME": folder, "XDG_RUNTIME_DIR": folder, "PULSE_RUNTIME_PATH": folder},
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            until = time.monotonic() + 20.0
            while not Path(socket).exists() and time.monotonic() < until:
                time.sleep(0.1)
            config = Path(folder) / "asoundrc"
            config.write_text(
                "</usr/share/alsa/alsa.conf>\n"
                + CARD.format(name="exciter", device="exciter", socket=socket)
                + CARD.format(name="monitor", device="exciter.monitor", socket=socket)
            )
            os.environ["ALSA_CONFIG_PATH"] = str(config)
            os.environ["JACK_NO_START_SERVER"] = "1"
            return heard()
        finally:
            server.terminate()
            server.wait(timeout=10.0)


def heard() -> dict[str, object]:
    """Drive noise through the sink in a program that has not looked for cards before."""
    cards = [card.full_name for card in list_cards()]
    delays, same = [], []
    with open_rig("sound:ALSA/exciter", display(2, input_device="ALSA/monitor", lead_s=1.0)) as rig:
        assert isinstance(rig, SoundRig)
        for seed in (1, 2, 3):
            trace = rig.drive(np.random.default_rng(seed).uniform(-1.9, 1.9, (96000, 2)))
            asked, back = trace.command_v[:, 0], trace.position_v[:, 0]
            late = delay_of(asked, back)
            wired = (asked[: asked.size - late] / 2.0).astype(np.float32) * 2.0
            delays.append(late)
            same.append(float(np.mean(np.isclose(wired, back[late:], rtol=0.0, atol=1e-6))))
        return {"cards": cards, "delays": delays, "same": same, "gaps": rig.gaps}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(run()) + "\n")

"""Clicks from the source to the finger port, by `listen` as anyone calls it: the delay of what is felt.

What is felt is the displacement at the finger port, weighted here by the inverse of the threshold curve's file (read
here), with zero phase; the delay ends at its greatest magnitude within 100 ms. Run: python -m witnesses.live.delay
CONTROLLER [CLICKS [CODING ...]].
"""

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import soundfile

import tactuator as tt
from witnesses.live.limits import FloatArray, felt_of

RATE_IN, EVERY_S = 48000, 0.2
GAIN_DB = {"direct": 85.0, "bands": 85.0, "envelope": 85.0}


def delays_ms(controller: Any, coding: str, clicks: int, folder: Path) -> dict[str, FloatArray]:
    rng = np.random.default_rng(0)
    begin = (RATE_IN * (0.2 + EVERY_S * np.arange(clicks)) + rng.integers(0, 4000, clicks)).astype(int)
    sound = np.zeros(round(RATE_IN * EVERY_S * (clicks + 1)))
    sound[begin] = 0.9
    soundfile.write(folder / "clicks.wav", sound, RATE_IN)
    rig = tt.SimulatedRig(controller.display, seed=1)
    moved: dict[str, list[FloatArray]] = {name: [] for name in rig.channels}
    for name, pieces in moved.items():
        rig.finger(name).attach(pieces.append)
    tt.listen(
        rig, controller, folder / "clicks.wav", coding=coding, gain_db=GAIN_DB[coding], gate_db=0.0, fast=True
    ).run()
    found = {}
    for name, pieces in moved.items():
        felt, late = np.abs(felt_of(np.concatenate(pieces), rig.rate_hz)), []
        for at in begin / RATE_IN * rig.rate_hz:
            first = int(np.ceil(at))
            late.append((first + np.argmax(felt[first : first + round(0.1 * rig.rate_hz)]) - at) / rig.rate_hz * 1e3)
        found[name] = np.array(late)
    return found


def main() -> None:
    controller = tt.read_controller(sys.argv[1])
    clicks = int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    with tempfile.TemporaryDirectory() as folder:
        for coding in sys.argv[3:] or GAIN_DB:
            for name, late in delays_ms(controller, coding, clicks, Path(folder)).items():
                figures = f"median {np.median(late):.1f} ms, worst {late.max():.1f} ms, least {late.min():.1f} ms"
                print(f"{coding} {name}: {clicks} clicks, {figures}", flush=True)


if __name__ == "__main__":
    main()

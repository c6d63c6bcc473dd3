"""The verb `sound demo`: the whole calibration on a simulated exciter behind a simulated card."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactuator.cli.sound.calibrate_display import deliver
from tactuator.measure.open_loop.chain import CalibrationRequest
from tactuator.rig.sound.demo.display import demo_display, demo_exciter
from tactuator.rig.sound.demo.server import simulated_card


def run(out: Path, seed: int, as_json: bool) -> None:
    """Calibrate a simulated exciter behind a simulated sound card: PortAudio and a JACK server, in real time."""
    exciter = demo_exciter(np.random.default_rng(seed))
    with simulated_card([exciter], seed=seed) as card:
        deliver(
            demo_display(exciter),
            f"sound:{card.device}",
            out,
            CalibrationRequest((10.0, 400.0), 20.0, 50.0),
            seed,
            as_json,
        )

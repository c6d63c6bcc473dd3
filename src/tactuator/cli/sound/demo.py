"""The verb `sound demo`: the whole calibration on a simulated exciter behind a simulated card."""

from __future__ import annotations

import contextlib
import signal
import sys
from pathlib import Path

import numpy as np

from tactuator.cli.sound.calibrate_display import deliver
from tactuator.measure.open_loop import CalibrationRequest
from tactuator.rig.sound.exciter import demo_display, demo_exciter
from tactuator.rig.sound.simulated_card import SimulatedCard, simulated_card


def run(out: Path, seed: int, keep: bool, as_json: bool) -> None:
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
        if keep:
            _keep(card, out)


def _keep(card: SimulatedCard, out: Path) -> None:
    """Say how another terminal reaches the exciter, and wait for Ctrl-C."""
    sys.stderr.write(
        f"the exciter stays until Ctrl-C; in another terminal: export JACK_DEFAULT_SERVER={card.name}; then "
        f"tactuator play REFERENCE --rig sound:{card.device} --controller {out / 'controller.json'}\n"
    )
    sys.stderr.flush()
    with contextlib.suppress(KeyboardInterrupt):
        signal.pause()

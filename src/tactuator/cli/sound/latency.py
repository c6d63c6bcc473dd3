"""The verb `sound latency`: the delay from an output to an input through a wire."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import typer
from rich.table import Table

from tactuator.cli.answer import answer, working
from tactuator.errors import BadInput
from tactuator.rig.open import open_rig
from tactuator.rig.sound.loopback import measure_delay, wire_display


def run(device: str, rate_hz: float, output: int, input_number: int, level: float, as_json: bool) -> None:
    """Measure the delay from an output to an input through a wire, and whether it stays: latency_samples of [sound]."""
    if input_number < 1:
        raise BadInput(f"input {input_number}", "the input to which the wire leads, counted from 1")
    display = wire_display(rate_hz, output, input_number)
    with open_rig(f"sound:{device}", display) as rig, working("listening to the wire"):
        found = measure_delay(rig, level, np.random.default_rng(0))
    table = Table("what", "value", title=f"{device}, output {output} to input {input_number}")
    table.add_row("latency_samples", str(found.samples))
    table.add_row("ms", f"{1e3 * found.samples / rate_hz:.3f}")
    table.add_row("spread (samples)", str(found.spread))
    table.add_row("gain", f"{found.gain:.4g}")
    result = {"device": device, "rate_hz": rate_hz, "latency_samples": found.samples, "delay": asdict(found)}
    answer(result, as_json, table)
    if found.spread > 1:
        raise typer.Exit(1)

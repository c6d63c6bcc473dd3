"""The verb `noise`: hum, noise and loop resonance, as a resting finger feels them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import typer
from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, working
from tactuator.cli.chosen import ask_for_load, chosen_controller, require_stable
from tactuator.cli.controller.check import verdict_table
from tactuator.cli.response.measure import frequencies
from tactuator.io.formats.environment import write_environment
from tactuator.measure.noise import FeltNoise, felt_noise, noise_verdict, proportional_controller, unstable_channels
from tactuator.model.controller import Controller
from tactuator.model.verdict import Outcome
from tactuator.rig.finger import touch_all
from tactuator.rig.open import open_rig


def run(
    display: Path | None,
    controller: Path | None,
    gains: str,
    duration_s: float,
    load: str,
    mains_hz: float,
    write: Path | None,
    rig: str,
    seed: int,
    as_json: bool,
) -> None:
    """Compare felt levels with the threshold, under proportional gains and under the loop; exit status 1 if one is
    felt.
    """
    made = chosen_controller(display, controller)
    require_stable(made, load)
    open_loops = [one.name for one in made.channels if one.feedback_sos is None]
    probed, left_out = _probes(made, frequencies(gains), load)
    runs = [
        (name, _heard(candidate, name, made, duration_s, load, mains_hz, rig, seed))
        for name, candidate in [*probed, ("loop", made)]
    ]
    verdict = noise_verdict(runs[-1][1], made.display, open_loops)
    if write is not None:
        write_environment(write, {one.channel: one.sensor.keys() for one in runs[-1][1] if one.sensor is not None})
    answer(
        {
            "runs": [{"under": name, "channels": [document(one) for one in felt]} for name, felt in runs],
            "not_played": left_out,
            "written": None if write is None else str(write),
            **verdict.document(),
        },
        as_json,
        Group(
            _table(runs),
            *(f"not played: {name}: {why}" for name, why in left_out.items()),
            *(f"measured, {one.channel}: {one.sensor.environment()}" for one in runs[-1][1] if one.sensor is not None),
            verdict_table(verdict),
            *([f'written: {write}; to judge by it: measured = "{write.name}" under [environment]'] if write else []),
        ),
    )
    if verdict.outcome is Outcome.NOT_MET:
        raise typer.Exit(1)


def _heard(
    candidate: Controller,
    name: str,
    made: Controller,
    duration_s: float,
    load: str,
    mains_hz: float,
    rig: str,
    seed: int,
) -> Sequence[FeltNoise]:
    """Return what is felt of a display at rest under one controller."""
    with working(f"listening under {name}"), open_rig(rig, candidate.display, seed) as opened:
        ask_for_load(touch_all(opened, made.display.channels, load), load)
        opened.load(candidate)
        return felt_noise(opened, made.display, duration_s=duration_s, load=load, mains_hz=mains_hz or None)


def _probes(made: Controller, gains: Iterable[float], load: str) -> tuple[list[tuple[str, Controller]], dict[str, str]]:
    """Return the proportional controllers to listen to, by name, and why others are not played."""
    played: list[tuple[str, Controller]] = []
    left_out: dict[str, str] = {}
    for gain in gains:
        name, probe = f"gain {gain:g}", proportional_controller(made.display, gain)
        unstable = unstable_channels(probe, load)
        if any(one.feedback_sos is None for one in made.channels):
            left_out[name] = "the display is driven without a loop: there is nothing to close"
        elif unstable:
            left_out[name] = f"the display's models call the loop of {', '.join(unstable)} unstable"
        else:
            played.append((name, probe))
    return played, left_out


def document(felt: FeltNoise) -> dict[str, Any]:
    """Return one channel under one controller, as `--json` prints it."""
    return vars(felt) | {
        "sensor": None if felt.sensor is None else vars(felt.sensor),
        "worst_line_db_sl": felt.worst_line_db_sl,
        "worst_noise_db_sl": felt.worst_noise_db_sl,
    }


def _table(runs: Sequence[tuple[str, Sequence[FeltNoise]]]) -> Table:
    table = Table(
        "under", "channel", "worst mains line (dB SL)", "worst third octave (dB SL)", "resonance (dB SL)",
        caption="levels as a finger feels them",
    )  # fmt: skip
    for name, felt in runs:
        for one in felt:
            resonance = (
                "none" if one.resonance_hz is None else f"{one.resonance_db_sl:.1f} at {one.resonance_hz:.0f} Hz"
            )
            worst = float(max(one.band_db_sl))
            table.add_row(name, one.channel, _level(one.worst_line_db_sl), _level(worst), resonance)
    return table


def _level(level_db_sl: float) -> str:
    return f"{level_db_sl:.1f}" if isfinite(level_db_sl) else "none"

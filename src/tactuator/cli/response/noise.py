"""The verb `noise`: hum, noise and loop resonance, as a resting finger feels them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import typer
from rich.table import Table

from tactuator.cli.answer import answer
from tactuator.cli.options import (
    AsJson,
    ControllerOption,
    DisplayOption,
    RigOption,
    Seed,
    ask_for_load,
    chosen_controller,
)
from tactuator.cli.response.measure import frequencies
from tactuator.measure.noise import FeltNoise, felt_noise
from tactuator.measure.proportional import proportional_controller
from tactuator.rig.open import open_rig
from tactuator.rig.touchable import touch_all


def register(app: typer.Typer) -> None:
    """Add the verb to the application."""

    @app.command()
    def noise(
        display: DisplayOption = None,
        controller: ControllerOption = None,
        gains: Annotated[
            str, typer.Option("--gains", help="Proportional gains to probe with, comma between; empty for none.")
        ] = "2,4,8,16,32",
        duration_s: Annotated[float, typer.Option("--duration-s", help="Seconds listened to each.")] = 8.0,
        load: Annotated[str, typer.Option("--load", help="Load of the display file, or none.")] = "none",
        mains_hz: Annotated[float, typer.Option("--mains-hz", help="Mains frequency; 0 for none.")] = 60.0,
        rig: RigOption = "simulated",
        seed: Seed = 0,
        as_json: AsJson = False,
    ) -> None:
        """Compare felt levels with the threshold, under proportional gains and under the loop; exit status 1 if one is
        felt.
        """
        made = chosen_controller(display, controller)
        probed = [(f"gain {gain:g}", proportional_controller(made.display, gain)) for gain in frequencies(gains)]
        runs: list[tuple[str, Sequence[FeltNoise]]] = []
        for name, candidate in [*probed, ("loop", made)]:
            with open_rig(rig, candidate.display, seed) as opened:
                ask_for_load(touch_all(opened, made.display.channels, load), load)
                opened.load(candidate)
                felt = felt_noise(opened, made.display, duration_s=duration_s, load=load, mains_hz=mains_hz or None)
            runs.append((name, felt))
        designed = runs[-1][1]
        tolerated = made.display.objectives
        verdict = {
            "ii": all(one.worst_line_db_sl < tolerated.mains_max_db_sl for one in designed),
            "iii": all(one.worst_noise_db_sl < tolerated.noise_max_db_sl for one in designed),
        }
        answer(
            {"runs": [{"under": name, "channels": [document(one) for one in felt]} for name, felt in runs]}
            | {"objectives": verdict},
            as_json,
            _table(runs, verdict),
        )
        if not all(verdict.values()):
            raise typer.Exit(1)


def document(felt: FeltNoise) -> dict[str, Any]:
    """Return one channel under one controller, as `--json` prints it."""
    return vars(felt) | {
        "worst_line_db_sl": felt.worst_line_db_sl,
        "worst_noise_db_sl": felt.worst_noise_db_sl,
    }


def _table(runs: Sequence[tuple[str, Sequence[FeltNoise]]], verdict: dict[str, bool]) -> Table:
    caption = ", ".join(f"objective {name}: {'met' if met else 'not met'}" for name, met in verdict.items())
    table = Table(
        "under", "channel", "worst line", "worst third octave", "resonance", caption=f"dB SL as felt; {caption}"
    )
    for name, felt in runs:
        for one in felt:
            resonance = (
                "none" if one.resonance_hz is None else f"{one.resonance_db_sl:.1f} at {one.resonance_hz:.0f} Hz"
            )
            worst = float(max(one.band_db_sl))
            table.add_row(name, one.channel, f"{one.worst_line_db_sl:.1f}", f"{worst:.1f}", resonance)
    return table

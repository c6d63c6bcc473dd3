"""The verbs for displays on sound cards, as the command line spells them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactuator.cli.deferred import Verbs, does
from tactuator.cli.options import AsJson, Seed

Device = Annotated[str, typer.Option("--device", help="Card, as `tactuator sound devices` lists it.")]
RateHz = Annotated[float, typer.Option("--rate-hz", help="Sampling rate.")]
Output = Annotated[int, typer.Option("--output", help="Output of the card, counted from 1.")]
LevelDbSl = Annotated[float, typer.Option("--level-db-sl", help="Level at which it must be usable and is verified.")]
BandHz = Annotated[str, typer.Option("--band-hz", help="Frequencies within which it is to be used: low,high.")]
MainsHz = Annotated[float, typer.Option("--mains-hz", help="Mains, whose multiples are kept off; 0: none.")]


@does("sound.devices:run")
def devices(as_json: AsJson = False) -> None:
    """Show the sound cards with their outputs, inputs and rates."""


@does("sound.latency:run")
def latency(
    device: Device,
    rate_hz: RateHz = 48000.0,
    output: Output = 1,
    input_number: Annotated[int, typer.Option("--input", help="Input of the card that a wire joins to it.")] = 1,
    level: Annotated[float, typer.Option("--level", help="Share of full scale.")] = 0.1,
    as_json: AsJson = False,
) -> None:
    """Measure the delay from an output to an input through a wire, and whether it stays: latency_samples of [sound]."""


@does("sound.calibrate:run")
def calibrate(
    device: Device,
    rate_hz: RateHz = 48000.0,
    output: Output = 1,
    frequency_hz: Annotated[float, typer.Option("--frequency-hz", help="Of the tone.")] = 100.0,
    level: Annotated[float, typer.Option("--level", help="Share of full scale.")] = 0.1,
    duration_s: Annotated[float, typer.Option("--duration-s", help="Of the tone, for the meter to settle.")] = 15.0,
    reading_v: Annotated[
        float | None, typer.Option("--reading-v", help="What the multimeter reads, V rms (default: asked for).")
    ] = None,
    input_number: Annotated[
        int, typer.Option("--input", help="Input that a wire joins to the output, to be calibrated by it; 0: none.")
    ] = 0,
    as_json: AsJson = False,
) -> None:
    """Play a tone for a multimeter and turn its reading into volts at full scale."""


@does("sound.demo:run")
def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder to write.")] = Path("out/sound-demo"),
    seed: Seed = 0,
    keep: Annotated[
        bool, typer.Option("--keep", help="Keep the exciter afterwards, for other commands, until Ctrl-C.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Calibrate a simulated exciter behind a simulated sound card: PortAudio and a JACK server, in real time."""


@does("sound.calibrate_display:run", reads=["display"])
def calibrate_display(
    display: Annotated[Path, typer.Argument(help="Display file (TOML) with [sound]; its plants are found anew.")],
    rig: Annotated[str, typer.Option("--rig", help="sound:DEVICE[@RATE].")] = "sound:",
    out: Annotated[Path, typer.Option("--out", help="Folder to write.")] = Path("out/calibrated"),
    level_db_sl: LevelDbSl = 20.0,
    band_hz: BandHz = "",
    mains_hz: MainsHz = 50.0,
    curve: Annotated[str | None, typer.Option("--curve", help="Threshold curve: a name, or a person's CSV.")] = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Find level, model, usable band and equaliser of a display without loop, and verify what is felt; exit status 1
    where that is not flat within the tolerance.
    """


VERBS: Verbs = {
    "sound devices": devices,
    "sound latency": latency,
    "sound calibrate": calibrate,
    "sound demo": demo,
    "calibrate-display": calibrate_display,
}

"""The verbs that measure a display, as the command line spells them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactuator.cli.deferred import Verbs, does
from tactuator.cli.options import AsJson, ControllerOption, DisplayOption, FiguresOption, RigOption, Seed


@does("response.noise:run", reads=["display", "controller"])
def noise(
    display: DisplayOption = None,
    controller: ControllerOption = None,
    gains: Annotated[
        str, typer.Option("--gains", help="Proportional gains to probe with, comma between; empty for none.")
    ] = "2,4,8,16,32",
    duration_s: Annotated[float, typer.Option("--duration-s", help="Seconds listened to each.")] = 8.0,
    load: Annotated[str, typer.Option("--load", help="Load of the display file, or none.")] = "none",
    mains_hz: Annotated[float, typer.Option("--mains-hz", help="Mains frequency; 0 for none.")] = 60.0,
    write: Annotated[
        Path | None, typer.Option("--write", help="File to write with the sensor's own hum and noise.")
    ] = None,
    rig: RigOption = "simulated",
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Compare felt levels with the threshold, under proportional gains and under the loop; exit status 1 if one is
    felt.
    """


@does("response.measure:run", reads=["display", "controller"])
def measure(
    display: DisplayOption = None,
    controller: ControllerOption = None,
    level_db_sl: Annotated[float, typer.Option("--level-db-sl", "--level", help="Level, dB SL.")] = 30.0,
    load: Annotated[str, typer.Option("--load", help="Load of the display file, or none.")] = "none",
    method: Annotated[str, typer.Option("--method", help="stepped or multisine.")] = "stepped",
    frequency: Annotated[
        str | None, typer.Option("--frequency-hz", help="Frequencies, comma between (default: 30 over the band).")
    ] = None,
    channel: Annotated[list[str] | None, typer.Option("--channel", help="Channel (default: all).")] = None,
    confidence_db: Annotated[float, typer.Option("--confidence-db", help="95 % half-width to reach.")] = 0.25,
    longest_s: Annotated[float, typer.Option("--longest-s", help="Seconds per point at most.")] = 30.0,
    mains_hz: Annotated[float, typer.Option("--mains-hz", help="Mains frequency; 0 for none.")] = 60.0,
    out: Annotated[Path | None, typer.Option("--out", help="Response to write (.h5 or .csv).")] = None,
    figures: FiguresOption = None,
    rig: RigOption = "simulated",
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Measure the response, off mains; exit status 1 if it is not flat, or the confidence was not reached."""


@does("response.disturb:run", reads=["display", "controller"])
def disturb(
    display: DisplayOption = None,
    controller: ControllerOption = None,
    channel: Annotated[list[str] | None, typer.Option("--channel", help="Channel (default: all).")] = None,
    frequency: Annotated[
        str, typer.Option("--frequency-hz", help="Frequencies of the rejection, comma between.")
    ] = "0.5,1,2,5,10,20,30,50,100",
    excursion_mm: Annotated[
        float, typer.Option("--excursion-mm", help="What each force would move without the loop.")
    ] = 1.0,
    rig: RigOption = "simulated",
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Press, lift and tremble at the finger port; rejection against frequency beside S."""


@does("response.finger:run", reads=["display", "controller"])
def finger(
    display: DisplayOption = None,
    controller: ControllerOption = None,
    load: Annotated[
        str | None,
        typer.Option("--load", help="Load of the display file that touches (default: finger, or the first)."),
    ] = None,
    level_db_sl: Annotated[float, typer.Option("--level-db-sl", "--level", help="Level of each line, dB SL.")] = 24.0,
    duration_s: Annotated[
        float, typer.Option("--duration-s", help="Seconds played, a little less than half of them free.")
    ] = 60.0,
    channel: Annotated[list[str] | None, typer.Option("--channel", help="Channel (default: all).")] = None,
    rig: RigOption = "simulated",
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Play free and touched; mass, damping and stiffness of what touches, with confidence, and whether they describe
    it. Exit status 1 where they do not.
    """


VERBS: Verbs = {"noise": noise, "measure": measure, "disturb": disturb, "finger": finger}

"""The verbs for speech, as the command line spells them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactuator.cli.deferred import Verbs, does
from tactuator.cli.options import AsJson, ControllerOption, DisplayOption, FiguresOption, RigOption, Seed


@does("speech.waveforms:run", reads=["display", "controller"])
def waveforms(
    out: Annotated[Path, typer.Option("--out", help="Folder for the references and protocol.toml.")],
    display: DisplayOption = None,
    controller: ControllerOption = None,
    duration: Annotated[float, typer.Option("--duration", help="Of every waveform, seconds.")] = 0.5,
    level: Annotated[float, typer.Option("--level", help="Of every component, dB SL.")] = 40.0,
    fingers: Annotated[str, typer.Option("--fingers", help="Groups: names with +, groups with commas.")] = (
        "thumb,index,middle,all"
    ),
    repetitions: Annotated[int, typer.Option("--repetitions", min=1, help="Of each item in the test.")] = 10,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Write kinesthetic, middle and cutaneous waveforms, singly and combined, and a protocol to ask for them."""


@does("speech.render:run", reads=["speech", "display", "controller"])
def render(
    speech: Annotated[Path, typer.Argument(help="Speech file: WAV, FLAC, Ogg, AIFF, ...")],
    out: Annotated[Path, typer.Option("--out", help="Reference to write: .wav (with NAME.json) or .h5.")],
    display: DisplayOption = None,
    controller: ControllerOption = None,
    coding: Annotated[
        str, typer.Option("--coding", help="direct, bands, envelope, yuan-2005, bratakos-2001, or FILE.toml.")
    ] = "direct",
    level: Annotated[float, typer.Option("--level", help="Level of the utterance, dB SL.")] = 35.0,
    felt: Annotated[
        Path | None, typer.Option("--felt", help="What the simulated display's fingers feel, to write.")
    ] = None,
    figures: FiguresOption = None,
    save_coding: Annotated[
        Path | None, typer.Option("--save-coding", help="TOML to write: the coding, every parameter in it.")
    ] = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Code speech onto the fingers, set its level in dB SL, keep the display's limits, write the reference."""


@does("speech.play:run", reads=["reference", "display", "controller"])
def play(
    reference: Annotated[Path, typer.Argument(help="Reference that `render` wrote: .wav or .h5.")],
    display: DisplayOption = None,
    controller: ControllerOption = None,
    rig: RigOption = "simulated",
    realtime: Annotated[bool, typer.Option("--realtime", help="Keep time on a rig that could go faster.")] = False,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Play a reference. Space pauses and goes on, q or Ctrl-C stops: that ramps down, and the rig comes to rest."""


@does("speech.corpus:run", reads=["folder", "display", "controller"])
def corpus(
    folder: Annotated[Path, typer.Argument(help="Folder of speech files, looked through to its depths.")],
    out: Annotated[Path, typer.Option("--out", help="Folder of references; what is finished there is kept.")],
    display: DisplayOption = None,
    controller: ControllerOption = None,
    coding: Annotated[str, typer.Option("--coding", help="As for `render`.")] = "direct",
    level: Annotated[float, typer.Option("--level", help="Level of every utterance, dB SL.")] = 35.0,
    felt: Annotated[bool, typer.Option("--felt", help="Put what is felt of each file into the manifest.")] = False,
    hdf5: Annotated[bool, typer.Option("--hdf5", help="References as .h5 in place of .wav.")] = False,
    workers: Annotated[int | None, typer.Option("--workers", min=1, help="Processes (default: cores).")] = None,
    scheduler: Annotated[str | None, typer.Option("--scheduler", help="Address of a Dask scheduler.")] = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Render a corpus: restartable, with a manifest; exit status 1 if a file failed."""


VERBS: Verbs = {"waveforms": waveforms, "render": render, "play": play, "corpus": corpus}

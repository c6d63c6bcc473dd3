"""The verbs from models to images, as the command line spells them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactuator.cli.deferred import Verbs, does
from tactuator.cli.options import AsJson, ControllerOption, FiguresOption, Seed
from tactuator.rig.boards import BOARDS

BoardOption = Annotated[str, typer.Option("--board", help=f"Board: {', '.join(BOARDS)}.")]


@does("controller.design:run", reads=["display"])
def design(
    display: Annotated[Path, typer.Argument(help="Display file (TOML).")],
    out: Annotated[Path, typer.Option("--out", help="Controller file to write.")] = Path("controller.json"),
    curve: Annotated[str | None, typer.Option("--curve", help="Threshold curve: a name, or a CSV.")] = None,
    poles: Annotated[int | None, typer.Option("--poles", min=2, max=16, help="Poles of the prefilters.")] = None,
    error_db: Annotated[
        float | None, typer.Option("--error-db", min=0.01, help="Choose the fewest poles that keep this error.")
    ] = None,
    figures: FiguresOption = None,
    as_json: AsJson = False,
) -> None:
    """Design loop and prefilter of every channel, and write them as a controller file; exit status 1 if not met."""


@does("controller.check:run", reads=["controller", "display"])
def check(
    controller: Annotated[Path, typer.Argument(help="Controller file.")],
    display: Annotated[Path | None, typer.Option("--display", help="Display file to judge it for.")] = None,
    monte_carlo: Annotated[
        int, typer.Option("--monte-carlo", min=0, help="Plants to draw for each channel and load; 0 for none.")
    ] = 0,
    mode_shift: Annotated[
        float, typer.Option("--mode-shift", help="Relative standard deviation of the frequency of a mode.")
    ] = 0.02,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Judge a controller by the paper's four objectives and by what a board takes; exit status 1 if one fails."""


@does("controller.wordlength:run", reads=["controller"])
def wordlength(
    controller: Annotated[Path, typer.Argument(help="Controller file that `design` wrote.")],
    rate: Annotated[float | None, typer.Option("--rate", help="Another sampling rate, hertz.")] = None,
    number_format: Annotated[
        str | None, typer.Option("--format", help="Ask for the verdict on one format: exit status 1 if unsafe.")
    ] = None,
    figures: FiguresOption = None,
    as_json: AsJson = False,
) -> None:
    """Say which number formats are safe for a controller, and recommend the smallest."""


@does("controller.build:run", reads=["controller"])
def build(
    controller: Annotated[Path, typer.Argument(help="Controller file that `design` wrote.")],
    out: Annotated[Path, typer.Option("--out", help="Image file to write.")],
    number_format: Annotated[str, typer.Option("--format", help="Number format: float32 or q31.")] = "float32",
    as_json: AsJson = False,
) -> None:
    """Write a controller as the image that a board loads; a format that is not safe for it is refused."""


@does("controller.image:run", reads=["file", "controller"])
def image(
    file: Annotated[Path, typer.Argument(help="Image file that `build` wrote.")],
    controller: Annotated[
        Path | None, typer.Option("--controller", help="Controller file: is the image its, and for its display?")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say what an image is, once the core has checked all of it; exit status 1 if it is another controller's."""


@does("controller.firmware:program")
def program(
    board: BoardOption = "mps2-an500",
    out: Annotated[Path, typer.Option("--out", help="File to write: .elf, .bin or .hex.")] = Path("firmware.elf"),
    emulated: Annotated[bool, typer.Option("--emulated", help="For the emulator, not the board itself.")] = False,
    crystal_mhz: Annotated[
        int | None, typer.Option("--crystal-mhz", min=4, max=26, help="Of the board itself: 12 if not given.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compile a board's program from core/ and firmware/."""


@does("controller.firmware:verify", reads=["controller"])
def verify(
    board: BoardOption = "mps2-an500",
    rig: Annotated[
        str | None, typer.Option("--rig", help="A board that is connected, instead: board:PORT or board:URL.")
    ] = None,
    ticks: Annotated[int, typer.Option("--ticks", help="Ticks of the interrupt, in each format.")] = 100_000,
    controller: ControllerOption = None,
    as_json: AsJson = False,
) -> None:
    """Compare what a board's interrupt does with this machine's, bit for bit; exit status 1 if they differ."""


@does("controller.firmware:stream", reads=["controller"])
def stream(
    board: BoardOption = "mps2-an500",
    seconds: Annotated[float, typer.Option("--seconds", help="Seconds of the board's time.")] = 10.0,
    instruction_ns: Annotated[
        int, typer.Option("--instruction-ns", help="What an instruction takes: 1, 2, 4, 8 (125 MIPS), ...")
    ] = 8,
    controller: ControllerOption = None,
    as_json: AsJson = False,
) -> None:
    """Stream a reference to a board whose time goes on; exit status 1 if an interrupt was late or a row missing."""


@does("controller.firmware:bench", reads=["controller"])
def bench(
    controller: ControllerOption = None,
    rig: Annotated[
        str | None, typer.Option("--rig", help="A connected board with a counter of cycles, instead; it plays.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Count the instructions of one period on every board, in every format, in the usual run and in others.

    With --rig, the processor's cycles on a connected board, at rest, in silence and with tones of 26 dB SL.
    """


@does("controller.firmware:acknowledge")
def acknowledge(
    rig: Annotated[str, typer.Option("--rig", help="The board: board:PORT or board:URL.")],
    as_json: AsJson = False,
) -> None:
    """Tell a board that its sensor faults are known: after three of them it stays off until then."""


VERBS: Verbs = {
    "design": design,
    "check": check,
    "wordlength": wordlength,
    "build": build,
    "image": image,
    "firmware program": program,
    "firmware verify": verify,
    "firmware stream": stream,
    "firmware bench": bench,
    "firmware acknowledge": acknowledge,
}

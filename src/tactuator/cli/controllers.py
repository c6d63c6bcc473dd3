"""How a verb is told which controller to use: a controller file, or a display file to design one for."""

from pathlib import Path
from typing import Annotated

import typer

from tactuator.digital.controller import Controller
from tactuator.errors import BadInput
from tactuator.files.controller import read_controller
from tactuator.files.display import read_display

DisplayOption = Annotated[
    Path | None, typer.Option("--display", help="Display file; a controller is designed for it if none is given.")
]
ControllerOption = Annotated[Path | None, typer.Option("--controller", help="Controller file that `design` wrote.")]


def chosen_controller(display: Path | None, controller: Path | None) -> Controller:
    """The controller of a file, or one designed for a display. BadInput for neither, or for two that do not fit."""
    if controller is not None:
        made = read_controller(controller)
        if display is not None and _points(made) != _points_of_display(display):
            raise BadInput(f"{controller} was not designed for {display}; allowed: one of the two, or two that fit")
        return made
    if display is None:
        raise BadInput("neither --display nor --controller; allowed: one of them")
    from tactuator.design.controller import design_controller  # its solvers take a second to load

    return design_controller(read_display(display))


def _points(controller: Controller) -> tuple[float, tuple[str, ...]]:
    return controller.rate_hz, tuple(channel.name for channel in controller.channels)


def _points_of_display(path: Path) -> tuple[float, tuple[str, ...]]:
    display = read_display(path)
    return display.rate_hz, tuple(channel.name for channel in display.channels)

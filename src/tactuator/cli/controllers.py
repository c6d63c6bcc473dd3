"""How a verb is told which controller to use: a controller file, or a display file to design one for."""

from dataclasses import replace
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
    """The controller of a file, or one designed for a display; with both, the file's on that display.

    BadInput for neither, or for two that do not fit.
    """
    if controller is not None:
        made = read_controller(controller)
        if display is None:
            return made
        shown = read_display(display)
        try:
            made.require_runs(shown)
        except BadInput as error:
            raise BadInput(f"{controller} was not designed for {display}: {error}") from None
        return replace(made, display=shown)
    if display is None:
        raise BadInput("neither --display nor --controller; allowed: one of them")
    from tactuator.design.controller import design_controller  # its solvers take a second to load

    return design_controller(read_display(display))

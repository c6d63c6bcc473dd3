"""Resources that options of several verbs name: a controller, and a hand that puts a load on."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tactuator.cli.answer import working
from tactuator.errors import BadInput
from tactuator.io.controller import read_controller
from tactuator.io.display import read_display
from tactuator.model.controller import Controller


def chosen_controller(display: Path | None, controller: Path | None) -> Controller:
    """Return the controller of a file, or one designed for a display; with both, that of the file on that display.

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
            raise error.within(f"{controller} was not designed for {display}") from None
        return replace(made, display=shown)
    if display is None:
        raise BadInput("neither --display nor --controller", "one of them")
    from tactuator.synthesis.design import design_controller  # its solvers take a second to load

    with working("designing a controller"):
        return design_controller(read_display(display))


def require_stable(controller: Controller, load: str = "none") -> None:
    """Refuse a loop that the display's own models call unstable, without a load or under `load`: it is never closed."""
    from tactuator.measure.noise import unstable_channels  # SciPy takes a second to load

    unstable = unstable_channels(controller, load)
    if unstable:
        raise BadInput(
            f"the display's models call the loop of {', '.join(unstable)} unstable (load {load!r})",
            "a controller whose loop is stable there",
        )


def ask_for_load(channels: Sequence[str], load: str) -> None:
    """Tell the person at the terminal to put a load on the channels that no program can reach."""
    if channels:
        sys.stderr.write(f"tactuator: put the load {load!r} on {', '.join(channels)} by hand now\n")

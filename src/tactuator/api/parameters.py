"""Parameters that several functions share: a display, a controller, a rig, a load that a person puts on."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from tactuator.api.option import Option
from tactuator.api.progress import say, working
from tactuator.errors import BadInput, within
from tactuator.io.controller import read_controller
from tactuator.io.csv_tables import resolve_curve
from tactuator.io.display import read_display, with_curve
from tactuator.io.shipped import EXAMPLES
from tactuator.measure.noise import unstable_channels
from tactuator.model.controller import Controller
from tactuator.model.description import Channel, Display
from tactuator.perception.curve import ThresholdCurve
from tactuator.rig.open import open_rig
from tactuator.rig.rig import Rig, touch_all
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.paper import PREFILTER_POLES

Place = str | PathLike[str]
Numbers = Any
"""Real numbers: a list, an array, or a text with commas between. `numbers` reads and checks them."""
DISPLAY_HELP = "Display file; a controller is designed for it if none is given."
CONTROLLER_HELP = "Controller file that `design` wrote."
RIG_HELP = "Rig: simulated, in-process, board:URL, sound:DEVICE."

Seed = Annotated[int, Option("Seed of all randomness; the same seed, the same result.", ge=0)]
DisplayOption = Annotated[Display | Place | None, Option(DISPLAY_HELP, file=True)]
ControllerOption = Annotated[Controller | Place | None, Option(CONTROLLER_HELP, file=True, shell=None)]
Figures = Annotated[Place | None, Option("Folder for the figures (SVG, and their numbers as CSV).", writes="folder")]
RigOption = Annotated[Rig | str, Option(RIG_HELP, type=str, shell="simulated")]
Lsl = Annotated[bool, Option("Send onsets, levels and answers by Lab Streaming Layer.")]
Channels = Annotated[Sequence[str] | None, Option("Channel (default: all).", ("--channel",), type=list[str] | None)]
Load = Annotated[str, Option("Load of the display file, or none.")]
MainsHz = Annotated[
    float | None, Option("Mains frequency; 0: none (default: by the display's hum_hz, else 60; cards 50).")
]
Curve = Annotated[Any, Option("Threshold curve: a name, or a CSV.", type=str | None)]
Host = Annotated[str, Option("Address to listen at; another than loopback lets others in.")]
AllowedHosts = Annotated[
    list[str] | None,
    Option("Another host name to answer to (of a proxy).", ("--allowed-host",), metavar="NAME"),
]
TlsCertificate = Annotated[
    Place | None, Option("Certificate file (PEM) for an encrypted connection; with --tls-key.", type=str | None)
]
TlsKey = Annotated[Place | None, Option("Key file (PEM) of the certificate, without a password.", type=str | None)]


def chosen_display(display: Display | Place, curve: Any = None) -> Display:
    """Return the display, or that of a file; a curve, or its name or file, replaces the display's."""
    described = display if isinstance(display, Display) else read_display(Path(display))
    if curve is None:
        return described
    return with_curve(described, curve if isinstance(curve, ThresholdCurve) else resolve_curve(str(curve)))


def read(controller: Controller | Place) -> Controller:
    """Return the controller, or that of a file."""
    return controller if isinstance(controller, Controller) else read_controller(Path(controller))


def chosen_controller(display: Display | Place | None, controller: Controller | Place | None) -> Controller:
    """Return the controller, or that of a file, or one designed for a display; with both, it on that display.

    BadInput for neither, or for two that do not fit.
    """
    if controller is not None:
        loaded = read(controller)
        if display is None:
            return loaded
        shown = chosen_display(display)
        with within(f"{controller} was not designed for {display}"):
            loaded.require_runs(shown)
        return replace(loaded, display=shown)
    if display is None:
        raise BadInput("neither `display` nor `controller`", "one of them")

    with working("designing a controller"):
        return design_controller(chosen_display(display))


def paper_display() -> Display:
    """Return the display as the paper describes it, index finger first, with two plausible siblings."""
    return read_display(EXAMPLES / "display.toml")


def paper_controller(display: Display) -> Controller:
    """Return the paper's C on every channel, and a prefilter of the paper's order fitted to each channel's curve."""
    channels = tuple(
        replace(channel, feedback=replace(channel.feedback, structure="paper")) for channel in display.channels
    )
    return design_controller(replace(display, channels=channels), poles=PREFILTER_POLES)


@contextmanager
def opened(rig: Rig | str, display: Display, seed: int = 0) -> Iterator[Rig]:
    """Yield the rig of that name with the display on it, closed in the end; a rig that is open already stays so."""
    if isinstance(rig, str):
        with open_rig(rig, display, seed) as ready:
            yield ready
    else:
        yield rig


def require_stable(controller: Controller, load: str = "none") -> None:
    """Refuse a loop that the display's own models call unstable, without a load or under `load`: it is never closed."""
    unstable = unstable_channels(controller, load)
    if unstable:
        raise BadInput(
            f"the display's models call the loop of {', '.join(unstable)} unstable (load {load!r})",
            "a controller whose loop is stable there",
        )


def put_load(rig: Rig, channels: Sequence[Channel], load: str) -> None:
    """Put a load on channels; ask the person at the terminal to do it where the program cannot."""
    if by_hand := touch_all(rig, channels, load):
        say(f"put the load {load!r} on {', '.join(by_hand)} by hand now")


def put_on(rig: Rig, controller: Controller, load: str, channels: Sequence[str] | None = None) -> str:
    """Put a load on every channel, under which the loop is stable, as `put_load` does.

    Return the load that touches the channels then: where "none" is asked, one that touched an open rig before. Raises
    BadInput where these differ or make `controller` unstable.
    """
    put_load(rig, controller.display.channels, load)
    if load != "none" or not rig.has_finger_ports:
        return load
    touching = {name: rig.finger(name).load or "none" for name in channels or rig.channels}
    if len(set(touching.values())) > 1:
        listed = ", ".join(f"{name}: {load}" for name, load in touching.items())
        raise BadInput(f"not the same on all channels ({listed})", "one load on all", key="load")
    if (touches := next(iter(touching.values()))) != load:
        require_stable(controller, touches)
    return touches


def numbers(values: Any, key: str) -> NDArray[np.float64]:
    """Return real numbers, or those of a text with commas between, as (n,). BadInput, with that key, for all else."""
    cells = [cell for cell in values.split(",") if cell.strip()] if isinstance(values, str) else values
    with suppress(TypeError, ValueError):
        array = np.atleast_1d(np.asarray(cells))
        if array.ndim == 1 and not np.iscomplexobj(array):
            return array.astype(np.float64)
    got = " ".join(repr(values).split())[:80]
    raise BadInput(got, "real numbers, in a list or in a text with commas between", key=key)


def paths(places: Any) -> list[Any]:
    """Return a list of one or several places (or objects in their place); empty for None."""
    if places is None:
        return []
    return list(places) if isinstance(places, list | tuple) else [places]

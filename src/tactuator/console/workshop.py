"""The displays that a console works on, and the controllers that were made for them."""

from __future__ import annotations

import hashlib
import tomllib
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from tactuator import __version__
from tactuator.console.chart.bench import Bench, bench
from tactuator.console.drawer import Drawer
from tactuator.console.figures import channel_controller
from tactuator.console.shaping.factors import Factor, LoopShape
from tactuator.console.shaping.taken_apart import taken_apart
from tactuator.errors import BadInput
from tactuator.io.display import parse_display, read_display
from tactuator.io.shipped import EXAMPLES, example_names
from tactuator.io.text import parse_toml, read_text
from tactuator.model.controller import ChannelController, Controller
from tactuator.model.description import Display
from tactuator.signals.decibels import db
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.design import design_channel

FILE = "file"
_EXAMPLE, _TEXT = "example:", "text:"
_BENCHES, _MADE, _TEXTS = 32, 256, 64
_START_SHARE = 0.05
_Key = TypeVar("_Key")
_Value = TypeVar("_Value")


class Workshop:
    """Displays by key: `file`, the one that was named on the command line, or `example:NAME`; and what was dropped.

    folder: where the stores of experiments are (default: the folder in which the console was begun).
    """

    def __init__(self, path: Path | None = None, folder: Path | None = None) -> None:
        self._path, self.drawer = path, Drawer()
        self.folder = folder or Path()
        self._displays: dict[str, Display] = {}
        self._own: dict[tuple[str, str], ChannelController] = {}
        self._texts: OrderedDict[str, tuple[str, Path]] = OrderedDict()
        self._benches: OrderedDict[tuple[str, str], Bench] = OrderedDict()
        self._made: OrderedDict[tuple[str, str, LoopShape], ChannelController] = OrderedDict()
        if path is not None:
            self.open(FILE)

    @property
    def named(self) -> str | None:
        """Return the key of the display that was named on the command line, or None."""
        return None if self._path is None else FILE

    def examples(self) -> list[dict[str, str]]:
        """Return the displays that come with the package: key, name and channels, as texts."""
        found = []
        for name in example_names():
            if name == "display.toml" or name.startswith("displays/"):
                tables = tomllib.loads((EXAMPLES / name).read_text("utf-8"))
                channels = ", ".join(str(channel["name"]) for channel in tables["channel"])
                found.append({"key": f"{_EXAMPLE}{name}", "name": str(tables["display"]["name"]), "channels": channels})
        return found

    def path(self, key: str) -> Path:
        """Return the file of a key. Raises BadInput for one that is not known."""
        if key == FILE and self._path is not None:
            return self._path
        name = key.removeprefix(_EXAMPLE)
        if key.startswith(_EXAMPLE) and name in example_names() and name.endswith(".toml"):
            return EXAMPLES / name
        if key.startswith(_TEXT):
            raise BadInput("that text of a display is not on the server any more", "open it from the view Display")
        raise BadInput(f"display {key!r}", f"{FILE} where one was named, or an example's key")

    def text(self, key: str) -> str:
        """Return the text of a display's file, or the one that was written on the page."""
        return self._texts[key][0] if key in self._texts else read_text(self.path(key))

    def take_text(self, text: str, beside: str | None) -> str:
        """Keep a display that was written on the page and return its key; its paths start where those of the display
        `beside` do. Raises BadInput where the text describes no display.
        """
        folder = Path() if beside is None else self._folder(beside)
        display = parse_display(parse_toml(text), folder)
        key = _TEXT + hashlib.sha256(f"{folder}:{text}".encode()).hexdigest()[:16]
        if key not in self._texts:
            _keep(self._texts, key, (text, folder), _TEXTS)
            self._displays[key] = display
        return key

    def _folder(self, key: str) -> Path:
        return self._texts[key][1] if key in self._texts else self.path(key).parent

    def command_name(self, key: str) -> str:
        """Return the display file as a command line names it; an example as `init --examples examples` copies it."""
        if key in self._texts:
            return "display.toml"
        return str(self._path) if key == FILE else f"examples/{key.removeprefix(_EXAMPLE)}"

    def open(self, key: str) -> Display:
        """Read a display anew; what was made for another content of the file is forgotten."""
        if key in self._texts:
            text, folder = self._texts[key]
            self._displays[key] = parse_display(parse_toml(text), folder)
            return self._displays[key]
        display = read_display(self.path(key))
        self._displays[key] = display
        self._benches = OrderedDict((one, kept) for one, kept in self._benches.items() if one[0] != key)
        self._made = OrderedDict((one, kept) for one, kept in self._made.items() if one[0] != key)
        self._own = {one: kept for one, kept in self._own.items() if one[0] != key}
        return display

    def display(self, key: str) -> Display:
        """Return a display that is open, or open it."""
        return self._displays.get(key) or self.open(key)

    def bench(self, key: str, channel: str) -> Bench:
        """Return the bench of a channel. Raises BadInput for a channel that is not there, or without a loop."""
        made = self._benches.get((key, channel))
        if made is None:
            display = self.display(key)
            described = display.channel(channel)
            if described.feedback.structure == "none":
                raise BadInput(f"channel {channel!r} has no loop (structure is none)", "a channel with one")
            made = bench(display, described)
            _keep(self._benches, (key, channel), made, _BENCHES)
        return made

    def begun(self, key: str, channel: str) -> LoopShape:
        """Return a shape to begin with: an integrator and a double zero at the plant's corner, turned down until every
        loop is stable.
        """
        on = self.bench(key, channel)
        rate_hz = on.display.rate_hz
        upper = on.channel.feedback.rejection_band_hz[1]
        factors = (Factor("integrator"), Factor("zero", (0.3 * upper,)), Factor("pole", (_START_SHARE * rate_hz,)))
        unit = LoopShape(0.0, factors)
        crossing = unit.system(rate_hz).response(upper) * on.family[0].sampled.response(upper)
        sign = 1 if on.family[0].sampled.response(1e-3 * upper).real >= 0.0 else -1
        for turned_down_db in range(0, 120, 6):
            shape = LoopShape(-float(db(crossing)) - turned_down_db, factors, sign)
            system = shape.system(rate_hz)
            if all(FeedbackLoop(system, member.sampled).is_stable for member in on.family):
                return shape
        return LoopShape(-100.0, (), sign)

    def designed(self, key: str, channel: str) -> LoopShape:
        """Run the synthesis for one channel and return what it found. Raises BadInput or NoDesign with the reason."""
        on = self.bench(key, channel)
        made = design_channel(on.display, on.channel)
        feedback = made.feedback(on.display.rate_hz)
        assert feedback is not None
        shape = taken_apart(feedback)
        self.keep(key, channel, shape, made)
        return shape

    def own_design(self, key: str, channel: str) -> ChannelController:
        """Return what the synthesis makes of a channel as its file describes it, made once; channels without a loop
        have their prefilter.
        """
        display = self.display(key)
        if (key, channel) not in self._own:
            self._own[key, channel] = design_channel(display, display.channel(channel))
        return self._own[key, channel]

    def own_controller(self, key: str) -> Controller:
        """Return the controller that `design` makes of a display."""
        display = self.display(key)
        return Controller(display, tuple(self.own_design(key, one.name) for one in display.channels), __version__)

    def made(self, key: str, channel: str, shape: LoopShape) -> ChannelController:
        """Return the controller of a shape: what the synthesis made, as it made it, or one with a prefilter fitted to
        it. Raises BadInput where the loop is unstable or no prefilter fits.
        """
        own = self.known(key, channel, shape)
        if own is None:
            own = channel_controller(self.bench(key, channel), self.system(key, channel, shape))
            self.keep(key, channel, shape, own)
        return own

    def known(self, key: str, channel: str, shape: LoopShape) -> ChannelController | None:
        """Return the controller of a shape if it was made before, or None."""
        return self._made.get((key, channel, shape))

    def keep(self, key: str, channel: str, shape: LoopShape, own: ChannelController) -> None:
        """Keep the controller that was made of a shape; of many the oldest are forgotten."""
        _keep(self._made, (key, channel, shape), own, _MADE)

    def system(self, key: str, channel: str, shape: LoopShape) -> SampledSystem:
        """Return C of a shape at the display's rate."""
        return shape.system(self.bench(key, channel).display.rate_hz)

    def controller(self, key: str, shapes: Mapping[str, LoopShape]) -> Controller:
        """Return the controller of all channels; channels without a loop are designed. Raises BadInput where a channel
        with a loop has no shape.
        """
        display = self.display(key)
        made = []
        for channel in display.channels:
            if channel.feedback.structure == "none":
                made.append(design_channel(display, channel))
            elif channel.name in shapes:
                made.append(self.made(key, channel.name, shapes[channel.name]))
            else:
                raise BadInput(f"channel {channel.name!r} has no loop yet", "a loop for every channel")
        return Controller(display, tuple(made), __version__)


def _keep(kept: OrderedDict[_Key, _Value], key: _Key, value: _Value, most: int) -> None:
    kept[key] = value
    while len(kept) > most:
        kept.popitem(last=False)

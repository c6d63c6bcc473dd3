"""The displays that a console works on, and the controllers that were made for them."""

from __future__ import annotations

import hashlib
import tomllib
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from tactuator import __version__
from tactuator.console.loop_chart import ChannelPlants, channel_controller, channel_plants
from tactuator.console.loop_shape import Factor, LoopShape, taken_apart
from tactuator.console.uploads import EXAMPLE, UploadedFiles
from tactuator.errors import BadInput, unquoted
from tactuator.io.display import parse_display, read_display
from tactuator.io.shipped import EXAMPLES, example_names
from tactuator.io.text import parse_toml, read_text, require_inside
from tactuator.model.controller import ChannelController, Controller
from tactuator.model.description import Display
from tactuator.signals.decibels import db
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis import design

FILE = "file"
_TEXT = "text:"
_START_SHARE = 0.05
_Value = TypeVar("_Value")


class ConsoleState:
    """Displays by key: `file`, the one that was named on the command line, or `example:NAME`; and what was dropped.

    folder: where the stores of experiments are (default: the folder in which the console was begun). has_rig: whether
    the console has a rig.
    """

    def __init__(self, path: Path | None = None, folder: Path | None = None) -> None:
        self._path, self.uploads, self.has_rig = path, UploadedFiles(), False
        self.folder = folder or Path()
        self._displays: dict[str, Display] = {}
        self._texts: _Newest[tuple[str, Path]] = _Newest(64)
        self._plants: _Newest[ChannelPlants] = _Newest(32)
        self._shaped: _Newest[ChannelController] = _Newest(256)
        self._designed: _Newest[ChannelController] = _Newest(256)
        if path is not None:
            self._displays[FILE] = read_display(path)

    @property
    def named(self) -> str | None:
        """Return the key of the display that was named on the command line, or None."""
        return None if self._path is None else FILE

    def examples(self) -> list[dict[str, str]]:
        """Return the displays that come with the package: key, name and channels, as texts."""
        examples = []
        for name in example_names():
            if name == "display.toml" or name.startswith("displays/"):
                tables = tomllib.loads((EXAMPLES / name).read_text("utf-8"))
                channels = ", ".join(str(channel["name"]) for channel in tables["channel"])
                title = str(tables["display"]["name"])
                examples.append({"key": f"{EXAMPLE}{name}", "name": title, "channels": channels})
        return examples

    def path(self, key: str) -> Path:
        """Return the file of a key. Raises BadInput for one that is not known."""
        if key == FILE and self._path is not None:
            return self._path
        name = key.removeprefix(EXAMPLE)
        if key.startswith(EXAMPLE) and name in example_names() and name.endswith(".toml"):
            return EXAMPLES / name
        if key.startswith(_TEXT):
            raise BadInput("that text of a display is not on the server any more: open it from the view Display")
        raise BadInput(f"display {key!r}", f"{FILE} where one was named, or an example's key")

    def text(self, key: str) -> str:
        """Return the text of a display's file, or the one that was written on the page."""
        return self._texts[key,][0] if (key,) in self._texts else read_text(self.path(key))

    def take_text(self, text: str, beside: str | Path | None) -> str:
        """Keep a display that was written on the page and return its key; its paths start where those of the display
        `beside` do, or at that folder. Raises BadInput where the text describes no display.
        """
        folder = Path() if beside is None else beside if isinstance(beside, Path) else self._folder(beside)
        document = parse_toml(text)
        display = self._parsed(document, folder)
        key = _TEXT + hashlib.sha256(f"{folder}:{text}".encode()).hexdigest()[:16]
        if (key,) not in self._texts:
            self._texts.keep((key,), (text, folder))
            self._displays[key] = display
        return key

    @staticmethod
    def _parsed(document: Mapping[str, Any], folder: Path) -> Display:
        """Return the display of a page's text; the files that it names are within the folder and are not quoted."""
        require_inside(document, folder)
        with unquoted():
            return parse_display(document, folder)

    def _folder(self, key: str) -> Path:
        return self._texts[key,][1] if (key,) in self._texts else self.path(key).parent

    def command_name(self, key: str) -> str:
        """Return the display file as a command line names it; an example as `init --examples examples` copies it."""
        if (key,) in self._texts:
            return "display.toml"
        return str(self._path) if key == FILE else f"examples/{key.removeprefix(EXAMPLE)}"

    def open(self, key: str) -> Display:
        """Read a display anew; what was made for another content of the file is forgotten."""
        if (key,) in self._texts:
            text, folder = self._texts[key,]
            self._displays[key] = self._parsed(parse_toml(text), folder)
            return self._displays[key]
        with unquoted():
            display = read_display(self.path(key))
        if self._displays.get(key) == display:
            return self._displays[key]
        self._displays[key] = display
        for kept in (self._plants, self._shaped, self._designed):
            kept.forget(key)
        return display

    def display(self, key: str) -> Display:
        """Return a display that is open, or open it."""
        return self._displays.get(key) or self.open(key)

    def plants(self, key: str, channel: str) -> ChannelPlants:
        """Return what a channel's chart is drawn on. Raises BadInput for a channel that is not there or has no loop."""
        plants = self._plants.get((key, channel))
        if plants is None:
            display = self.display(key)
            described = display.channel(channel)
            if described.feedback.structure == "none":
                raise BadInput(f"channel {channel!r} has no loop (structure is none)", "a channel with one")
            plants = channel_plants(display, described)
            self._plants.keep((key, channel), plants)
        return plants

    def first_shape(self, key: str, channel: str) -> LoopShape:
        """Return a shape to begin with: an integrator and a double zero at the plant's corner, turned down until every
        loop is stable.
        """
        plants = self.plants(key, channel)
        rate_hz = plants.display.rate_hz
        upper = plants.channel.feedback.rejection_band_hz[1]
        factors = (Factor("integrator"), Factor("zero", (0.3 * upper,)), Factor("pole", (_START_SHARE * rate_hz,)))
        unit = LoopShape(0.0, factors)
        crossing = unit.system(rate_hz).response(upper) * plants.family[0].sampled.response(upper)
        sign = 1 if plants.family[0].sampled.response(1e-3 * upper).real >= 0.0 else -1
        for turned_down_db in range(0, 120, 6):
            shape = LoopShape(-float(db(crossing)) - turned_down_db, factors, sign)
            system = shape.system(rate_hz)
            if all(FeedbackLoop(system, member.sampled).is_stable for member in plants.family):
                return shape
        return LoopShape(-100.0, (), sign)

    def designed(self, key: str, channel: str) -> LoopShape:
        """Return the loop that the synthesis makes of a channel. Raises BadInput or NoDesign with the reason."""
        self.plants(key, channel)
        self.file_design(key, channel)
        shape = self.known_design(key, channel)
        assert shape is not None
        return shape

    def known_design(self, key: str, channel: str) -> LoopShape | None:
        """Return the loop of a channel's design where that is made already, or None."""
        controller = self._designed.get((key, channel))
        feedback = None if controller is None else controller.feedback(self.display(key).rate_hz)
        if controller is None or feedback is None:
            return None
        shape = taken_apart(feedback)
        self.keep(key, channel, shape, controller)
        return shape

    def file_design(self, key: str, channel: str) -> ChannelController:
        """Return what the synthesis makes of a channel as its file describes it, made once; channels without a loop
        have their prefilter.
        """
        display = self.display(key)
        if (key, channel) not in self._designed:
            first = design.first_alike(display, display.channel(channel))
            former = None if first is None else self.file_design(key, first.name)
            made = design.design_channel(display, display.channel(channel), former=former)
            self._designed.keep((key, channel), made)
        return self._designed[key, channel]

    def file_controller(self, key: str) -> Controller:
        """Return the controller that `design` makes of a display."""
        display = self.display(key)
        return Controller(
            display, tuple(self.file_design(key, channel.name) for channel in display.channels), __version__
        )

    def channel_of(self, key: str, channel: str, shape: LoopShape) -> ChannelController:
        """Return the controller of a shape: what the synthesis made, as it made it, or one with a prefilter fitted to
        it. Raises BadInput where the loop is unstable or no prefilter fits.
        """
        controller = self.known(key, channel, shape)
        if controller is None:
            controller = channel_controller(self.plants(key, channel), self.system(key, channel, shape))
            self.keep(key, channel, shape, controller)
        return controller

    def known(self, key: str, channel: str, shape: LoopShape) -> ChannelController | None:
        """Return the controller of a shape if it was made before, or None."""
        return self._shaped.get((key, channel, shape))

    def keep(self, key: str, channel: str, shape: LoopShape, controller: ChannelController) -> None:
        """Keep the controller that was made of a shape; of many the oldest are forgotten."""
        self._shaped.keep((key, channel, shape), controller)

    def system(self, key: str, channel: str, shape: LoopShape) -> SampledSystem:
        """Return C of a shape at the display's rate."""
        return shape.system(self.plants(key, channel).display.rate_hz)

    def controller(self, key: str, shapes: Mapping[str, LoopShape]) -> Controller:
        """Return the controller of all channels; channels without a loop are designed. Raises BadInput where a channel
        with a loop has no shape.
        """
        display = self.display(key)
        channels = []
        for channel in display.channels:
            if channel.feedback.structure == "none":
                channels.append(self.file_design(key, channel.name))
            elif channel.name in shapes:
                channels.append(self.channel_of(key, channel.name, shapes[channel.name]))
            else:
                raise BadInput(f"channel {channel.name!r} has no loop yet", "a loop for every channel")
        return Controller(display, tuple(channels), __version__)


class _Newest(OrderedDict[tuple[Any, ...], _Value]):
    """The newest values, so many at most, by keys that begin with that of a display."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self._most = most

    def keep(self, key: tuple[Any, ...], value: _Value) -> None:
        self[key] = value
        while len(self) > self._most:
            self.popitem(last=False)

    def forget(self, display: str) -> None:
        for key in [key for key in self if key[0] == display]:
            del self[key]

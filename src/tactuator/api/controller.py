"""From a model to a board: design, check, wordlength, build, image, acknowledge."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tactuator import report
from tactuator.api.designed import ControllerResult
from tactuator.api.option import Argument, Option
from tactuator.api.parameters import CONTROLLER_HELP, Curve, Figures, Place, Seed, chosen_display, read
from tactuator.api.progress import say, working
from tactuator.errors import BadInput, given_as, within
from tactuator.io.atomic import atomic_path
from tactuator.io.kinds import require_kind
from tactuator.io.text import read_content
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.model.verdict import Verdict
from tactuator.parameters import HIGHEST_RATE_HZ, checked
from tactuator.result import Fact, Result, ResultTable, found
from tactuator.rig.open import acknowledge_faults
from tactuator.runtime.image import ImageRefusal, check_image, read_image_header
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.monte_carlo import monte_carlo as draw_plants
from tactuator.synthesis.monte_carlo import plants_table
from tactuator.synthesis.objectives import whole_verdict
from tactuator.wordlength.bits import MOST_BITS, BitsNeeded, at_rate, controller_bits
from tactuator.wordlength.float32_check import Float32Check, built, check_float32

_RATE_DOUBLINGS = 4
_Bytes = bytes

ControllerFile = Annotated[Controller | Place, Argument(CONTROLLER_HELP, file=True)]


def design(
    display: Annotated[Display | Place, Argument("Display file (TOML).", file=True)],
    curve: Curve = None,
    poles: Annotated[int | None, Option("Poles of the prefilters.")] = None,
    error_db: Annotated[float | None, Option("Choose the fewest poles that keep this error.", ge=0.01)] = None,
    out: Annotated[
        Place | None, Option("Controller file to write.", writes="controller", shell=Path("controller.json"))
    ] = None,
    figures: Figures = None,
) -> ControllerResult:
    """Design loop and prefilter of every channel. Writes them to `out`, a controller file; `holds` is False if not met.

    curve: in place of the display's own. poles: of every prefilter; error_db: as few poles as keep that error.
    Raises NoDesign where no controller was found that meets what is asked.

    >>> tt.design("displays/voice-coil.toml").rate_hz
    8000.0
    """
    described = chosen_display(display, curve)
    if poles is not None:
        with given_as("poles", "poles"):
            replace(described.channels[0].prefilter, poles=poles)  # which refuses a number that is not allowed
    with working("designing"):
        controller = ControllerResult.of(design_controller(described, poles, error_db))
    if figures is not None:
        report.design_figures.save_design_figures(controller, Path(figures))
    if out is not None:
        _keep_met(Path(out), controller)
        controller.write(out)
    return controller


def _keep_met(out: Path, by: ControllerResult) -> None:
    """Copy the controller of a file aside if it is met, or was not judged, and the one to replace it is not met."""
    with suppress(BadInput, OSError):
        if not by.holds and whole_verdict(read(out)).outcome is not by.verdict.outcome:
            aside = out.with_suffix(f".before{out.suffix}")
            aside.write_bytes(out.read_bytes())
            say(f"the new controller is not met; the one that was in {out} is kept as {aside}")


def check(
    controller: Annotated[Controller | Place, Argument("Controller file.", file=True)],
    display: Annotated[Display | Place | None, Option("Display file to judge it for.", file=True)] = None,
    monte_carlo: Annotated[
        int, Option("Plants to draw for each channel and load; 0 for none.", ge=0, le=1_000_000)
    ] = 0,
    mode_shift: Annotated[
        float | None, Option("Relative standard deviation of the frequency of a mode; else as the model says, or 0.02.")
    ] = None,
    seed: Seed = 0,
) -> Verdict:
    """Judge a controller by the paper's four objectives. Also by what a board accepts; `holds` is False if one is
    not met.

    display: in place of the controller's own. Raises BadInput for one that the controller cannot run.

    >>> tt.check(controller).sentence  # this display does not give friction, noise and hum
    'not judged (i, iv, build: met; ii, iii: not judged)'
    """
    judged, shown = read(controller), None if display is None else chosen_display(display)
    drawn: list[Any] = []
    if monte_carlo:
        on = judged if shown is None else replace(judged, display=shown)
        on.require_runs(on.display)
        with working("drawing plants"):
            drawn = draw_plants(on, monte_carlo, np.random.default_rng(seed), mode_shift)
    verdict = whole_verdict(judged, shown, drawn)
    if not drawn:
        return verdict
    plants = Fact("monte_carlo", [each.document() for each in drawn])
    return replace(verdict, beside=(plants, plants_table(drawn)))


@dataclass(frozen=True, eq=False, repr=False)
class WordlengthResult(Result):
    """Word length of a controller: the most of any channel.

    bits: the fractional bits that F ("prefilter") and C ("feedback") need, by form and sampling rate (Hz). float32:
    what float32, the format of every image, does to the controller. figures: their folder, where they were asked for.
    """

    rate_hz: float
    bits: Mapping[str, Mapping[str, Mapping[float, BitsNeeded]]]
    float32: Float32Check
    figures: Path | None = None

    @property
    def holds(self) -> bool:
        return self.float32.safe

    def tables(self) -> Sequence[ResultTable | str]:

        def as_text(bits: int) -> str:
            return str(bits) if bits <= MOST_BITS else f"over {MOST_BITS}"

        rows = [
            (name, form, *(f"{as_text(bits.stable)} / {as_text(bits.accurate)}" for bits in by_rate.values()))
            for name, forms in self.bits.items()
            for form, by_rate in forms.items()
        ]
        rates = next(iter(self.bits["prefilter"].values()))
        title = "Fractional bits that the coefficients need: to be stable / to keep 0.1 dB"
        columns = ("filter", "form", *(f"{rate:g} Hz" for rate in rates))
        return [ResultTable(title, columns, tuple(rows)), self._float32_table()]

    def _float32_table(self) -> ResultTable:
        check = self.float32
        figures = (
            ("error of |H| (dB)", check.response_error_db, ".2g"),
            ("felt round-off (dB SL)", check.roundoff_db_sl, ".0f"),
            ("felt limit cycle (dB SL)", check.limit_cycle_db_sl, ".0f"),
        )
        rows = [("stable", "yes" if check.stable else "no")]
        rows += [(name, f"{value:{form}}") for name, value, form in figures if value is not None]
        rows.append(("safe", "yes" if check.safe else "no"))
        notes = () if check.refused is None else (f"{check.refused}.",)
        return ResultTable(f"float32 at {self.rate_hz:g} Hz", ("what", "value"), tuple(rows), notes)

    def facts(self) -> Sequence[Fact]:
        why = "" if self.float32.refused is None else f": {self.float32.refused}"
        return [
            Fact("rate_hz", self.rate_hz, "sampling rate", "Hz", "g", True),
            Fact("bits", self.bits),
            Fact("float32", self.float32),
            found("float32", "safe" if self.float32.safe else f"not safe{why}"),
            *([Fact("figures", self.figures)] if self.figures else []),
        ]


def word_length(
    controller: ControllerFile,
    rate: Annotated[float | None, Option("Another sampling rate, hertz.")] = None,
    figures: Figures = None,
) -> WordlengthResult:
    """Count the bits that the coefficients need. `holds` is False if float32 is not safe for it.

    The bits are counted at one, two, four and eight times the rate. Raises BadInput for a rate at which the controller
    cannot be.

    >>> tt.word_length(controller).float32.safe
    True
    """
    judged = read(controller)
    if rate is not None:
        with given_as("rate_hz", "rate"):
            judged = at_rate(judged, rate)
    rates = [judged.rate_hz * 2.0**k for k in range(_RATE_DOUBLINGS)]
    with working("counting the bits that the coefficients need"):
        bits = controller_bits(judged, [rate for rate in rates if rate <= HIGHEST_RATE_HZ])
    with working("comparing float32 with double precision"):
        check = check_float32(judged)
    if figures is not None:
        bands = [channel.threshold.band_hz for channel in judged.display.channels]
        band = f"{min(low for low, _ in bands):g}-{max(high for _, high in bands):g} Hz"
        report.figure.save_figures(
            [report.design_figures.resolution_figure(bits, "this controller (the most of any channel)", band)],
            Path(figures),
        )
    return WordlengthResult(judged.rate_hz, bits, check, None if figures is None else Path(figures))


@dataclass(frozen=True, eq=False, repr=False)
class ImageResult(Result):
    """An image as the core reads it. image: its file, if any; controller: its controller's hash; content: bytes.

    response_error_db: what float32 costs, of an image that was built here. is_of_controller: whether it is
    the image of the controller of which that was asked, which is `asked`.
    """

    image: Path | None
    bytes: int
    rate_hz: float
    delay_samples: int
    channels: int
    controller: str
    crc32: str
    content: _Bytes = field(repr=False)
    response_error_db: float | None = None
    is_of_controller: bool | None = None
    asked: str = field(default="", repr=False)

    @property
    def holds(self) -> bool:
        return self.is_of_controller is not False

    @checked
    def write(self, path: Place) -> None:
        """Write the image, whole or not at all."""
        with atomic_path(path, "image") as beside:
            beside.write_bytes(self.content)

    def facts(self) -> Sequence[Fact]:
        made = f"made from {self.asked}"
        facts = [
            Fact("bytes", self.bytes, "size", "bytes", summary=True),
            Fact("rate_hz", self.rate_hz, "sampling rate", "Hz", "g", True),
            Fact("delay_samples", self.delay_samples, "computing delay", "samples", summary=True),
            Fact("channels", self.channels, "channels", summary=True),
            Fact("controller", self.controller, "hash of the controller", summary=True),
            Fact("crc32", self.crc32, "checksum (CRC-32)", summary=True),
            Fact("response_error_db", self.response_error_db, "greatest error of |H|", "dB", ".1g", True),
            Fact("is_of_controller", self.is_of_controller, made, summary=True),
        ]
        return [Fact("image", self.image), *(fact for fact in facts if fact.value is not None)]


def _image(content: bytes, path: Place | None, **more: Any) -> ImageResult:
    """Return what the core reads of an image. Raises BadInput for what is none."""
    header = read_image_header(content)
    return ImageResult(
        None if path is None else Path(path), len(content), header.rate_hz, header.delay_samples,
        header.channels, header.controller_hash, f"{header.crc:08x}", content, **more,
    )  # fmt: skip


def build_image(
    controller: ControllerFile,
    out: Annotated[Place | None, Option("Image file to write.", writes="image", shell=...)] = None,
) -> ImageResult:
    """Write a controller as the image that a board loads. One for which float32 is not safe is refused.

    Raises BadInput for such a controller.

    >>> tt.build_image(controller).channels
    3
    """
    loaded = read(controller)
    with nullcontext() if out is None else atomic_path(out, "image") as beside:  # a missing folder is reported at once
        with working("comparing float32 with double precision"):
            content, report = built(loaded)
        if beside is not None:
            beside.write_bytes(content)
    return _image(content, out, response_error_db=float(report.response_error_db or 0.0))


def read_image(
    file: Annotated[Place, Argument("Image file that `build` wrote.", file=True)],
    controller: Annotated[Controller | Place | None, Option("Controller file to compare with.", file=True)] = None,
) -> ImageResult:
    """Show what a firmware image contains. `holds` is False if it is another controller's.

    Raises BadInput for what is no image, and with a controller for an image that its display could not run.

    >>> tt.build_image(controller).write("image.bin")
    >>> tt.read_image("image.bin", controller).is_of_controller
    True
    """
    require_kind(Path(file), "image")
    with within(f"image {file}"):
        content = read_content(Path(file))
        read_of = _image(content, file)
    if controller is None:
        return read_of
    loaded = read(controller)
    refusal = check_image(content, loaded.rate_hz, loaded.delay_samples, len(loaded.channels))
    if refusal is not ImageRefusal.GOOD:
        raise refusal.error(f"{file}", "image")
    asked = str(controller) if isinstance(controller, str | Path) else loaded.content_hash
    return replace(read_of, asked=asked, is_of_controller=loaded.content_hash == read_of.controller)


@dataclass(frozen=True, eq=False, repr=False)
class AcknowledgedResult(Result):
    """Faults of a board that were acknowledged."""

    rig: str
    sensor_faults: int

    def facts(self) -> Sequence[Fact]:
        return [
            Fact("rig", self.rig, "board", summary=True),
            Fact("sensor_faults", self.sensor_faults, "sensor and travel faults acknowledged", summary=True),
        ]


def acknowledge(rig: Annotated[str, Option("The board: board:PORT or board:URL.")]) -> AcknowledgedResult:
    """Acknowledge sensor faults on a board. After three faults it stays off until then."""
    if not rig.startswith("board:"):
        raise BadInput(f"rig {rig!r} is no connected board", "board:PORT or board:URL")
    return AcknowledgedResult(rig, acknowledge_faults(rig.removeprefix("board:")))

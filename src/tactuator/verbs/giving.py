"""The verb that gives what others read: a display's profile, configuration and fact sheet; a reference as a clip."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tactuator.errors import BadInput
from tactuator.table import Chart, ChartLine, ResultTable
from tactuator.verbs.parameters import Argument, Option, Place
from tactuator.verbs.pattern import MOST_LOSS_DB
from tactuator.verbs.result import Result, columns_of, figure, plain

if TYPE_CHECKING:
    from tactuator.arrays import FloatArray
    from tactuator.io.reference import ReferenceFile, ReferenceHead
    from tactuator.patterns.device import DeviceSheet
    from tactuator.patterns.files import GivenLoss
    from tactuator.patterns.rendering import PatternMap

OF_DISPLAYS, OF_REFERENCES = (".csv", ".acf", ".md"), (".haptic", ".ahap", ".wav")


@dataclass(frozen=True, eq=False, repr=False)
class GivenDisplay(Result):
    """What a display gives, as a file that others read."""

    path: Path
    sheet: "DeviceSheet"

    def headline(self) -> Mapping[str, str]:
        sheet = self.sheet
        return {
            "written": str(self.path),
            "channel": sheet.channel,
            "strongest": f"{sheet.acceleration_g.max():.3g} g, {sheet.level_db_sl.max():.1f} dB SL",
            "band": f"{sheet.band_hz[0]:g} to {sheet.band_hz[1]:g} Hz",
            "rise": figure(1e3 * sheet.rise_s, "ms", 3),
        }

    def to_dict(self) -> dict[str, Any]:
        return {"out": str(self.path), "sheet": plain(self.sheet), "acf": plain(self.sheet.map)}

    def columns(self) -> Mapping[str, Any]:
        names = ("frequency_hz", "level_db_sl", "acceleration_g", "displacement_mm", "binding")
        return {name: getattr(self.sheet, name) for name in names}

    def notices(self) -> Sequence[str]:
        return () if self.sheet.measured else ("nothing measured: the felt error is that of the controller's model",)

    def chart(self) -> Chart:
        sheet = self.sheet
        level = ChartLine("level", sheet.frequency_hz, sheet.level_db_sl, "o-", colour=0)
        force = ChartLine("acceleration", sheet.frequency_hz, sheet.acceleration_g, "s--", colour=1, right=True)
        return Chart(
            "frequency (Hz)", "greatest level (dB SL)", [level, force], log_x=True, right_label="greatest (g, peak)"
        )


@dataclass(frozen=True, eq=False, repr=False)
class GivenReference(Result):
    """A reference as a clip of another format, and what the clip does not carry of it. strength_1: what 1 stands for.

    most_loss_db: the rms of the levels' differences up to which it holds.
    """

    path: Path
    channels: tuple[str, ...]
    strength_1: str
    loss: "GivenLoss"
    most_loss_db: float

    @property
    def holds(self) -> bool:
        return self.loss.level_rms_db <= self.most_loss_db

    def to_dict(self) -> dict[str, Any]:
        figures = {"channels": list(self.channels), "strength_1": self.strength_1, "most_loss_db": self.most_loss_db}
        return {"out": str(self.path), **figures, "loss": plain(self.loss), "met": self.holds}

    def headline(self) -> Mapping[str, str]:
        return {
            "written": str(self.path),
            "1 stands for": self.strength_1,
            "level off by": f"{self.loss.level_rms_db:.2f} dB rms, {self.loss.level_worst_db:.1f} dB at worst",
            "pitch off by": figure(self.loss.frequency_shift_jnd, "JND rms", 2),
            "carried": f"{100.0 * self.loss.carried:.1f} % of the power",
        }

    def columns(self) -> Mapping[str, Any]:
        return columns_of(("what", "value"), self.headline().items())

    def tables(self) -> Sequence[ResultTable | str]:
        return [ResultTable(f"Of {', '.join(self.channels)}", ("what", "value"), tuple(self.headline().items()))]


def export(
    source: Annotated[Place, Argument("Controller of a display, or a reference.", file=True)],
    out: Annotated[
        Place, Option(f"File to write; its ending says what: {', '.join(OF_DISPLAYS + OF_REFERENCES)}.", writes=True)
    ],
    *,
    channel: Annotated[
        str | None, Option("Channel (default: of a display the first, of a reference the strongest).")
    ] = None,
    response: Annotated[
        Place | None, Option("Measured responses of the display, that `measure --out` wrote.", file=True)
    ] = None,
    most_loss_db: Annotated[
        float, Option("Of a reference: loss that is allowed, dB rms.", ("--most-loss",), ge=0)
    ] = MOST_LOSS_DB,
) -> GivenDisplay | GivenReference:
    """Give a display or a reference to others. Of a display's controller: Android's frequency profile (.csv), an
    actuator configuration (.acf), a fact sheet (.md); of a reference: a clip (.haptic, .ahap), or its acceleration
    (.wav).

    A reference holds where what is given differs from it by no more than `most_loss_db`. Raises BadInput for another
    ending, a channel that is not there, or a display that is too weak.

    >>> tt.export("controller.json", "sheet.md").path.name
    'sheet.md'
    """
    from tactuator.io.kinds import kind_of

    path, kind = Path(out), kind_of(Path(source))
    allowed = OF_DISPLAYS if kind == "controller" else OF_REFERENCES
    if kind not in ("controller", "reference"):
        raise BadInput(f"{source} is neither a controller nor a reference", "what `design` or `render` wrote")
    if path.suffix.lower() not in allowed:
        raise BadInput(f"ending {path.suffix!r} for a {kind}", ", ".join(allowed), where=(str(out),))
    if kind == "controller":
        return _display(Path(source), path, channel, response)
    if response is not None:
        raise BadInput(f"--response with the reference {source}", "--response with a controller")
    return _reference(Path(source), path, channel, most_loss_db)


def _display(source: Path, out: Path, channel: str | None, response: "Place | None") -> GivenDisplay:
    from tactuator.io.atomic import write_text
    from tactuator.io.controller import read_controller
    from tactuator.io.response import read_responses
    from tactuator.patterns.acf import acf_text
    from tactuator.patterns.android import profile_text
    from tactuator.patterns.device import device_sheet, sheet_text

    controller = read_controller(source)
    named = controller.display.channels[0].name if channel is None else channel
    sheet = device_sheet(controller, named, () if response is None else read_responses(Path(response)))
    device = f"{sheet.display}, {sheet.channel}"
    if out.suffix.lower() == ".csv":
        head = [f"{device}: greatest acceleration (peak) at the finger, one sinusoid at a time",
                f"strongest at {sheet.strongest_hz:g} Hz; limits of the display kept"]  # fmt: skip
        text = profile_text(sheet.profile, head)
    elif out.suffix.lower() == ".acf":
        text = acf_text(sheet.map, device, date.today().isoformat())
    else:
        text = sheet_text(sheet)
    write_text(out, text)
    return GivenDisplay(out, sheet)


def _reference(source: Path, out: Path, channel: str | None, most_loss_db: float) -> GivenReference:
    import numpy as np

    from tactuator.io.atomic import write_text
    from tactuator.io.reference import open_reference
    from tactuator.patterns.ahap import parse_ahap
    from tactuator.patterns.files import ahap_text, haptic_text, loss_of_clip, moving_tone, parse_haptic, shares_of
    from tactuator.patterns.rendering import MAPS

    file = open_reference(source)
    head, waves = file.head, _waves(file)
    if channel is not None and channel not in head.channels:
        raise BadInput(f"channel {channel!r}", ", ".join(head.channels))
    if out.suffix.lower() == ".wav":
        return _acceleration(waves, head, out, most_loss_db)
    place = int(np.argmax(np.sum(waves**2, axis=0))) if channel is None else head.channels.index(channel)
    wave, named = waves[:, place], (head.channels[place],)
    course = moving_tone(wave, head.rate_hz)
    is_haptic = out.suffix.lower() == ".haptic"
    mapping = _mapped(MAPS["haptic" if is_haptic else "ahap"], float(course.amplitude.max()))
    strength_1 = f"{mapping.full_db_sl:g} dB SL, pitch 0 to 1 for {mapping.band_hz[0]:g} to {mapping.band_hz[1]:g} Hz"
    text = (haptic_text if is_haptic else ahap_text)(*shares_of(course, mapping), f"strength 1: {strength_1}")
    clip = parse_haptic(text, legacy=False) if is_haptic else parse_ahap(text)
    loss = loss_of_clip(clip, mapping, wave, head.rate_hz)
    write_text(out, text)
    return GivenReference(out, named, strength_1, loss, most_loss_db)


def _waves(file: "ReferenceFile") -> "FloatArray":
    """Return the samples of a reference, (n, channels). Raises BadInput for one longer than clips are."""
    import numpy as np

    from tactuator.patterns.clip import LONGEST_S

    if file.duration_s > LONGEST_S:
        raise BadInput(f"{file.duration_s:g} s", f"up to {LONGEST_S:g} s", where=(str(file.path),))
    return np.concatenate([np.zeros((0, len(file.head.channels))), *file.blocks()])


def _mapped(mapping: "PatternMap", amplitude: float) -> "PatternMap":
    """Return a map whose strength 1 is the least tenth of a dB that holds an amplitude (threshold units)."""
    import math

    level = math.ceil(200.0 * math.log10(max(amplitude, 1e-9))) / 10.0
    if level <= 0.0:
        raise BadInput(f"nothing above {level:g} dB SL", "a reference that is felt")
    return replace(mapping, full_db_sl=level)


def _acceleration(waves: "FloatArray", head: "ReferenceHead", out: Path, most_loss_db: float) -> GivenReference:
    """Write the acceleration that a reference asks for, all channels, 16 bits, as a sound file."""
    import numpy as np
    import soundfile

    from tactuator.io.atomic import atomic_path
    from tactuator.patterns.device import acceleration_g
    from tactuator.patterns.files import GivenLoss

    asked_g = np.stack([acceleration_g(wave, head, name) for wave, name in zip(waves.T, head.channels, strict=True)])
    peak = float(np.abs(asked_g).max(initial=0.0))
    if np.abs(waves).max(initial=0.0) <= 1.0:
        raise BadInput("nothing above 0 dB SL", "a reference that is felt", where=(str(out),))
    shares = np.round(asked_g / peak * 32767.0).astype(np.int16)
    losses = [
        _quantised(wave, asked, share * peak / 32767.0, head.rate_hz)
        for wave, asked, share in zip(waves.T, asked_g, shares, strict=True)
        if np.abs(wave).max() > 1.0
    ]
    with atomic_path(out) as beside:
        rate, width = int(head.rate_hz), len(head.channels)
        with soundfile.SoundFile(beside, "w", rate, width, "PCM_16", format="WAV") as file:
            file.comment = f"acceleration: 1.0 = {peak:.6g} g (peak); channels {','.join(head.channels)}"
            file.write(shares.T)
    worst = GivenLoss(
        max(each.level_rms_db for each in losses),
        max(each.level_worst_db for each in losses),
        max(each.frequency_shift_jnd for each in losses),
        min(each.carried for each in losses),
    )
    return GivenReference(out, head.channels, f"{peak:.4g} g of acceleration (peak)", worst, most_loss_db)


def _quantised(wave: "FloatArray", asked_g: "FloatArray", given_g: "FloatArray", rate_hz: float) -> "GivenLoss":
    """Return what an acceleration of whole steps loses; both are brought to the rms of the reference (n,)."""
    import numpy as np

    from tactuator.patterns.files import loss_between

    scale = float(np.sqrt(np.mean(wave**2) / np.mean(asked_g**2)))
    return loss_between(scale * asked_g, scale * given_g, rate_hz)

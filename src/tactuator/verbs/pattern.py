"""The verb that looks at other people's haptic clips, and what `render` makes of one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tactuator.errors import BadInput
from tactuator.table import Chart, ChartLine, ResultTable
from tactuator.verbs.parameters import Argument, Figures, Option, Place
from tactuator.verbs.result import Result, figure, plain

if TYPE_CHECKING:
    from tactuator.model.controller import Controller
    from tactuator.patterns.clip import Clip
    from tactuator.patterns.rendering import PatternMap, RenderedClip

MOST_LOSS_DB = 3.0
MADE_FOR_HELP = "Device that the clip was made for: its ACF, or Android's frequency profile (.csv)."
LEGACY_HELP = "Take a .haptic whose frequency outlasts its amplitude, as older players do."
_POINTS = 500


@dataclass(frozen=True, eq=False, repr=False)
class PatternResult(Result):
    """A haptic clip of another format that keeps the format's rules. It holds where every device has to play it."""

    path: Path
    clip: "Clip"

    @property
    def holds(self) -> bool:
        return not self.clip.unsure

    def headline(self) -> Mapping[str, str]:
        clip = self.clip
        return {
            "format": clip.format,
            "duration": figure(clip.duration_s, "s"),
            "tones": str(len(clip.tones)),
            "taps": str(len(clip.taps)),
            "clamped": str(clip.clamped),
        }

    def to_dict(self) -> dict[str, Any]:
        clip = self.clip
        names = ("format", "duration_s", "clamped", "ignored", "unrendered", "unsure", "pitch_in_hz")
        figures = {name: plain(getattr(clip, name)) for name in names}
        counts = {"tones": len(clip.tones), "taps": [vars(tap) for tap in clip.taps]}
        return {"file": str(self.path), "valid": True, **figures, **counts}

    def notices(self) -> Sequence[str]:
        return clip_notices(self.clip)

    def chart(self) -> Chart:
        import numpy as np

        time_s, lines = np.linspace(0.0, self.clip.duration_s, _POINTS), []
        for number, tone in enumerate(self.clip.tones):
            inside = (time_s >= tone.start_s) & (time_s <= tone.end_s)
            strength = np.where(inside, tone.strength.at(time_s), np.nan)
            pitch = np.where(inside, tone.pitch.at(time_s), np.nan)
            lines.append(ChartLine("strength" if number == 0 else "", time_s, strength, colour=0))
            lines.append(ChartLine("pitch" if number == 0 else "", time_s, pitch, "--", colour=1, right=True))
        taps = self.clip.taps
        if taps:
            lines.append(ChartLine("taps", [tap.time_s for tap in taps], [tap.strength for tap in taps], "o", colour=3))
        pitches = "pitch (Hz)" if self.clip.pitch_in_hz else "pitch (0 to 1)"
        return Chart("time (s)", "strength (0 to 1)", lines, right_label=pitches)


def clip_notices(clip: "Clip") -> tuple[str, ...]:
    """Return what is to be known of a clip as it was read."""
    clamped = f"{clip.clamped} values were outside their range: the format takes them back to it"
    ignored = f"not known to the format, and left out: {_first(clip.ignored)}"
    unrendered = f"not rendered: {_first(clip.unrendered)}"
    unsure = f"not every device plays it: {'; '.join(clip.unsure)}"
    lines = {clamped: clip.clamped, ignored: clip.ignored, unrendered: clip.unrendered, unsure: clip.unsure}
    return tuple(line for line, there in lines.items() if there)


def _first(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


@dataclass(frozen=True, eq=False, repr=False)
class ActuatorResult(Result):
    """An actuator configuration file (ACF) that keeps the rules of it, as the map that it states."""

    path: Path
    map: "PatternMap"

    def headline(self) -> Mapping[str, str]:
        return {"format": "acf", **{name: str(value) for name, value in self._stated().items()}}

    def to_dict(self) -> dict[str, Any]:
        return {"file": str(self.path), "format": "acf", "valid": True, "map": plain(self._stated())}

    def _stated(self) -> dict[str, Any]:
        names = ("band_hz", "gain", "ducking", "tap_hz", "tap_s", "tap_gain", "tap_fade", "tap_shape")
        return {name: getattr(self.map, name) for name in names}

    def chart(self) -> Chart:
        ends = (("tones", self.map.band_hz), ("taps", self.map.tap_hz))
        lines = [ChartLine(words, (0.0, 1.0), hertz, "o-", colour=k) for k, (words, hertz) in enumerate(ends)]
        return Chart("pitch (0 to 1)", "frequency (Hz)", lines)


def pattern(
    clip: Annotated[Place, Argument("Clip: .haptic, .ahap, .hjif or Android's .xml; or an .acf.", file=True)],
    *,
    legacy: Annotated[bool, Option(LEGACY_HELP)] = False,
    figures: Figures = None,
) -> PatternResult | ActuatorResult:
    """Say what a haptic clip of another format is, and draw it. A clip that breaks a rule of its format is refused.

    An Android envelope that keeps the format's rules and that not every device has to play does not hold. Raises
    BadInput with the rule that a file breaks.

    >>> tt.pattern("knock.haptic")
    <Pattern format: haptic, duration: 0.3 s, tones: 1, taps: 1, clamped: 0>
    """
    from tactuator.patterns.files import read_clip

    path = Path(clip)
    result: PatternResult | ActuatorResult
    if path.suffix.lower() == ".acf":
        from tactuator.patterns.acf import read_acf

        result = ActuatorResult(path, read_acf(path))
    else:
        result = PatternResult(path, read_clip(path, legacy))
    if figures is not None:
        _draw(result.chart(), Path(figures), Path(clip).stem)
    return result


def _draw(chart: Chart, folder: Path, name: str) -> None:
    from tactuator.report.chart import chart_plate
    from tactuator.report.plate import save_plates

    save_plates([chart_plate(chart, name)], folder)


@dataclass(frozen=True, eq=False, repr=False)
class ClipResult(Result):
    """A haptic clip as a reference in dB SL, and what the display does not give of it. most_loss_db: the shortfall up
    to which it holds."""

    path: Path
    rendered: "RenderedClip"
    most_loss_db: float

    @property
    def holds(self) -> bool:
        return self.rendered.loss.shortfall_db_sl <= self.most_loss_db

    def headline(self) -> Mapping[str, str]:
        loss = self.rendered.loss
        return {
            "reference": str(self.path),
            "short by up to": figure(loss.shortfall_db_sl, "dB", 3),
            "clipped": figure(loss.clipped_s, "s", 3),
            "pitch moved by": figure(loss.frequency_shift_jnd, "JND", 2),
        }

    def to_dict(self) -> dict[str, Any]:
        rendered = self.rendered
        figures = {"format": rendered.clip.format, "duration_s": rendered.clip.duration_s, "map": plain(rendered.map)}
        return {
            "out": str(self.path), "clip": rendered.clip.name, **figures, "most_loss_db": self.most_loss_db,
            "loss": plain(rendered.loss.document()), "met": self.holds,
        }  # fmt: skip

    def notices(self) -> Sequence[str]:
        return clip_notices(self.rendered.clip)

    def columns(self) -> Mapping[str, Any]:
        loss = self.rendered.loss
        names = ("time_s", "asked_db_sl", "delivered_db_sl", "felt_db_sl")
        return {name: getattr(loss, name) for name in names}

    def chart(self) -> Chart:
        loss = self.rendered.loss
        asked = ChartLine("asked", loss.time_s, loss.asked_db_sl, colour=0)
        given = ChartLine("delivered", loss.time_s, loss.delivered_db_sl, "--", colour=1)
        felt = ChartLine("felt, by the model", loss.time_s, loss.felt_db_sl, ":", colour=3)
        return Chart("time (s)", "level (dB SL)", [asked, given, felt], limits={"threshold": 0.0})

    def tables(self) -> Sequence[ResultTable | str]:
        loss, rise = self.rendered.loss, self.rendered.loss.emphasis_rise_db
        rows = [
            ("short by up to", f"{loss.shortfall_db_sl:.1f} dB SL (allowed: {self.most_loss_db:g})"),
            ("short by, on average", f"{loss.mean_shortfall_db:.1f} dB"),
            ("the display's limits take back", f"{loss.clipped_s:.2f} s of {self.rendered.clip.duration_s:.2f} s"),
            ("pitch moved into the band, by up to", f"{loss.frequency_shift_jnd:.1f} JND"),
        ]
        if rise is not None:
            rows.append(("taps rise above what is beneath, asked and delivered", f"{rise[0]:.1f}, {rise[1]:.1f} dB"))
        return [ResultTable(f"Loss of {self.rendered.clip.name}", ("what", "value"), tuple(rows))]


def render_pattern(
    clip: Path, controller: "Controller", out: Path, level_db_sl: float, most_loss_db: float, legacy: bool,
    figures: Path | None, made_for: Path | None = None,
) -> ClipResult:  # fmt: skip
    """Render a clip to a reference, strength 1 being `level_db_sl`. Raises BadInput as `render` does."""
    from tactuator.io.reference import write_reference
    from tactuator.patterns.files import read_clip
    from tactuator.patterns.rendering import render_clip

    asked = read_clip(clip, legacy)
    rendered = render_clip(asked, controller, _map_of(asked, level_db_sl, made_for))
    with write_reference(out, rendered.head, len(rendered.reference)) as writer:
        writer.write(rendered.reference)
    result = ClipResult(out, rendered, most_loss_db)
    if figures is not None:
        _draw(result.chart(), figures, clip.stem)
    return result


def _map_of(clip: "Clip", level_db_sl: float, made_for: Path | None) -> "PatternMap":
    """Return what a clip's numbers stand for, on the device that it was made for where one is named."""
    from tactuator.patterns.acf import read_acf
    from tactuator.patterns.android import read_profile
    from tactuator.patterns.rendering import MAPS, android_map

    if made_for is None:
        return replace(MAPS[clip.format], full_db_sl=level_db_sl)
    is_android = clip.format.startswith("android")
    if (made_for.suffix.lower() == ".csv") != is_android or (clip.pitch_in_hz and not is_android):
        allowed = "a frequency profile (.csv) for Android's, an .acf for .haptic and .ahap"
        raise BadInput(f"{made_for.name} for {clip.name}", allowed, key="--made-for")
    if is_android:
        return android_map(read_profile(made_for), clip.format)
    return replace(read_acf(made_for), full_db_sl=level_db_sl)

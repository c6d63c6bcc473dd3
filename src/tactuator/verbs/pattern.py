"""The verb that looks at other people's haptic clips, and what `render` makes of one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tactuator.table import Chart, ChartLine, ResultTable
from tactuator.verbs.parameters import Argument, Figures, Option, Place
from tactuator.verbs.result import Result, columns_of, figure, plain

if TYPE_CHECKING:
    from tactuator.model.controller import Controller
    from tactuator.patterns.clip import Clip
    from tactuator.patterns.rendering import RenderedClip

MOST_LOSS_DB = 3.0
LEGACY_HELP = "Take a .haptic whose frequency outlasts its amplitude, as older players do."
_POINTS = 500


@dataclass(frozen=True, eq=False, repr=False)
class PatternResult(Result):
    """A haptic clip of another format that keeps the format's rules."""

    path: Path
    clip: "Clip"

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
        figures = {name: getattr(clip, name) for name in ("format", "duration_s", "clamped", "ignored", "pitch_in_hz")}
        counts = {"tones": len(clip.tones), "taps": [vars(tap) for tap in clip.taps]}
        return {"file": str(self.path), "valid": True, **figures, **counts}

    def notices(self) -> Sequence[str]:
        clip = self.clip
        clamped = f"{clip.clamped} values were outside 0 to 1: the format takes them back to it" if clip.clamped else ""
        ignored = f"the format passes over {', '.join(clip.ignored[:5])}" if clip.ignored else ""
        return tuple(line for line in (clamped, ignored) if line)

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


def pattern(
    clip: Annotated[Place, Argument("Clip: .haptic, .ahap or Android's .xml.", file=True)],
    *,
    legacy: Annotated[bool, Option(LEGACY_HELP)] = False,
    figures: Figures = None,
) -> PatternResult:
    """Say what a haptic clip of another format is, and draw it. A clip that breaks a rule of its format is refused.

    Raises BadInput with the rule that it breaks.

    >>> tt.pattern("knock.haptic")
    <Pattern format: haptic, duration: 0.3 s, tones: 1, taps: 1, clamped: 0>
    """
    from tactuator.patterns.clip import read_clip

    result = PatternResult(Path(clip), read_clip(Path(clip), legacy))
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
        """Return whether the display falls short by no more than was allowed."""
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
        figures = {"format": rendered.clip.format, "duration_s": rendered.clip.duration_s, "map": vars(rendered.map)}
        return {
            "out": str(self.path), "clip": rendered.clip.name, **figures, "most_loss_db": self.most_loss_db,
            "loss": plain(rendered.loss.document()), "met": self.holds,
        }  # fmt: skip

    def columns(self) -> Mapping[str, Any]:
        loss = self.rendered.loss
        rows = zip(loss.time_s, loss.asked_db_sl, loss.delivered_db_sl, strict=True)
        return columns_of(("time_s", "asked_db_sl", "delivered_db_sl"), rows)

    def chart(self) -> Chart:
        loss = self.rendered.loss
        asked = ChartLine("asked", loss.time_s, loss.asked_db_sl, colour=0)
        given = ChartLine("delivered", loss.time_s, loss.delivered_db_sl, "--", colour=1)
        return Chart("time (s)", "level (dB SL)", [asked, given], limits={"threshold": 0.0})

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
    figures: Path | None,
) -> ClipResult:  # fmt: skip
    """Render a clip to a reference, strength 1 being `level_db_sl`. Raises BadInput as `render` does."""
    from tactuator.io.reference import write_reference
    from tactuator.patterns.clip import read_clip
    from tactuator.patterns.rendering import MAPS, render_clip

    asked = read_clip(clip, legacy)
    rendered = render_clip(asked, controller, replace(MAPS[asked.format], full_db_sl=level_db_sl))
    with write_reference(out, rendered.head, len(rendered.reference)) as writer:
        writer.write(rendered.reference)
    result = ClipResult(out, rendered, most_loss_db)
    if figures is not None:
        _draw(result.chart(), figures, clip.stem)
    return result

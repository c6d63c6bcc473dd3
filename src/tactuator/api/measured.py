"""Results of playing and asking: responses, felt noise, thresholds, speech, and the whole study."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactuator.api.result import Result, lines_of, told
from tactuator.experiment.result.thresholds import MeasuredThreshold
from tactuator.io.atomic import atomic_path
from tactuator.io.response import write_responses
from tactuator.measure.error import error_db
from tactuator.measure.noise import FeltNoise
from tactuator.model.description import Display
from tactuator.rig.player import Played
from tactuator.signals.record import Response

if TYPE_CHECKING:
    from tactuator.report.lines import Lines


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredResponses(Result):
    """Responses of a display, one for each channel, at one level and load."""

    responses: tuple[Response, ...]
    display: Display

    def headline(self) -> Mapping[str, str]:
        """Return the greatest error of every channel."""
        return {
            one.channel: f"within {np.max(np.abs(error_db(one, self.display))):.2f} dB of {one.level_db_sl:g} dB SL at "
            f"{one.frequency_hz.size} frequencies (load {one.load})"
            for one in self.responses
        }

    def columns(self) -> Mapping[str, Any]:
        """Return channel, frequency (Hz), level (dB SL), error (dB), its 95 % half-width and the phase (degrees)."""
        rows = [
            (one.channel, *row)
            for one in self.responses
            for row in zip(
                one.frequency_hz,
                one.level_db_sl + error_db(one, self.display),
                error_db(one, self.display),
                one.confidence_db,
                np.degrees(one.phase_rad),
                strict=True,
            )
        ]
        names = ("channel", "frequency_hz", "level_db_sl", "error_db", "confidence_db", "phase_deg")
        return {name: [row[k] for row in rows] for k, name in enumerate(names)}

    def to_dict(self) -> dict[str, Any]:
        """Return the table's columns as lists."""
        return {name: [value if isinstance(value, str) else float(value) for value in values]
                for name, values in self.columns().items()}  # fmt: skip

    def lines(self) -> Lines:
        """Return the level of every channel over frequency."""
        each = [(o.channel, o.frequency_hz, o.level_db_sl + error_db(o, self.display)) for o in self.responses]
        return lines_of("frequency (Hz)", "level (dB SL)", each, log_x=True)

    def write(self, path: str | Path) -> None:
        """Write the responses as .h5 or .csv."""
        write_responses(path, self.responses)


@dataclass(frozen=True, eq=False, repr=False)
class FeltLevels(Result):
    """Hum and noise as a resting finger feels them, one entry for each channel."""

    channels: tuple[FeltNoise, ...]

    def headline(self) -> Mapping[str, str]:
        """Return the loudest mains line and the loudest third octave of every channel."""
        figures = {}
        for one in self.channels:
            hum, noise = (np.max(levels, initial=-np.inf) for levels in (one.line_db_sl, one.band_db_sl))
            figures[one.channel] = f"hum up to {hum:.1f} dB SL, noise up to {noise:.1f} dB SL"
        return figures

    def columns(self) -> Mapping[str, Any]:
        """Return channel, centre of the third octave (Hz) and felt level (dB SL)."""
        rows = [(o.channel, f, level) for o in self.channels for f, level in zip(o.band_hz, o.band_db_sl, strict=True)]
        return {name: [row[k] for row in rows] for k, name in enumerate(("channel", "band_hz", "level_db_sl"))}

    def lines(self) -> Lines:
        """Return the felt level of every third octave."""
        each = [(one.channel, one.band_hz, one.band_db_sl) for one in self.channels]
        return lines_of("third octave (Hz)", "felt level (dB SL)", each, log_x=True)


@dataclass(frozen=True, eq=False, repr=False)
class StoreThresholds(Result):
    """Thresholds of the finished runs of an experiment's store."""

    thresholds: tuple[MeasuredThreshold, ...]

    def headline(self) -> Mapping[str, str]:
        """Return the number of runs and subjects, and the range of the thresholds."""
        levels = [one.refit_db_sl for one in self.thresholds]
        people = {one.subject for one in self.thresholds}
        simulated = {"simulated": "nobody felt this"} if any(one.simulated for one in self.thresholds) else {}
        return {"runs": str(len(levels)), "subjects": str(len(people)),
                "thresholds": f"{min(levels):.1f} to {max(levels):.1f} dB SL", **simulated}  # fmt: skip

    def columns(self) -> Mapping[str, Any]:
        """Return subject, finger, frequency (Hz), refitted threshold with its interval (dB SL), and flags."""
        names = ("subject", "finger", "frequency_hz", "refit_db_sl", "refit_low_db_sl", "refit_high_db_sl", "trials")
        columns = {name: [getattr(one, name) for one in self.thresholds] for name in names}
        return columns | {"flags": [", ".join(one.flags) for one in self.thresholds]}

    def lines(self) -> Lines:
        """Return every subject's thresholds over frequency."""
        people = sorted({one.subject for one in self.thresholds})
        of = {
            name: sorted((o.frequency_hz, o.refit_db_sl) for o in self.thresholds if o.subject == name)
            for name in people
        }
        each = [(name, *zip(*points, strict=True)) for name, points in of.items()]
        return lines_of("frequency (Hz)", "threshold (dB SL)", each, log_x=True, points=True)


@dataclass(frozen=True, eq=False, repr=False)
class BuiltImage(Result):
    """A controller as the bytes that a board loads."""

    content: bytes
    number_format: str
    response_error_db: float

    def headline(self) -> Mapping[str, str]:
        """Return format, size and the error of the number format."""
        error = told(self.response_error_db, "dB", 2)
        return {"format": self.number_format, "size": f"{len(self.content)} bytes", "error of the format": error}

    def to_dict(self) -> dict[str, Any]:
        """Return format, size and error; the bytes are for `write`."""
        return {"format": self.number_format, "bytes": len(self.content), "response_error_db": self.response_error_db}

    def write(self, path: str | Path) -> None:
        """Write the image, whole or not at all."""
        with atomic_path(path) as beside:
            beside.write_bytes(self.content)


class PlayedResult(Result, Played):
    """A reference that was played: its length, and how much of it was played or limited."""

    def headline(self) -> Mapping[str, str]:
        """Return length, what was played and how long a limit was reached."""
        seconds = {"length": self.duration_s, "played": self.played_s, "saturated": self.saturated_s}
        return {name: f"{value:.2f} s" for name, value in seconds.items()}


@dataclass(frozen=True, eq=False, repr=False)
class SpokenResult(Result):
    """Speech as a reference in dB SL. document: the figures of `tactuator render --json`; path: what was written."""

    path: Path
    document: Mapping[str, Any]

    def headline(self) -> Mapping[str, str]:
        """Return the file, its length and the peak of every finger."""
        peaks = {name: told(level, "dB SL at the peak") for name, level in self.document["peak_db_sl"].items()}
        return {"reference": str(self.path), "duration": told(self.document["duration_s"], "s"), **peaks}

    def lines(self) -> Lines:
        """Return the peak of every finger."""
        peaks = self.document["peak_db_sl"]
        return lines_of("finger", "peak (dB SL)", [("peak", list(peaks), list(peaks.values()))], points=True)


@dataclass(frozen=True, eq=False, repr=False)
class PaperResult(Result):
    """The paper's study. folder: report.html, figures and summary.json; summary: its figures."""

    folder: Path
    summary: Mapping[str, Any]
    comparison: tuple[tuple[str, str, str], ...]

    def headline(self) -> Mapping[str, str]:
        """Return the first rows of the table paper against here, and where the report lies."""
        return {"report": str(self.folder / "report.html")} | {what: here for what, _, here in self.comparison[:4]}

    def columns(self) -> Mapping[str, Any]:
        """Return the table of README: what, paper, here."""
        return {name: [row[k] for row in self.comparison] for k, name in enumerate(("what", "paper", "here"))}

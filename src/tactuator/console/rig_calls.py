"""What passes between the server and the process that holds the rig."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.console.fields import Finite, Name, PageSetting
from tactuator.console.generator import GeneratorWave, Hertz
from tactuator.io.response import responses_csv
from tactuator.measure.error import ResponseLevels
from tactuator.measure.options import MeasurementOptions
from tactuator.model.controller import Controller
from tactuator.plain import picked
from tactuator.rig.rig import Trace
from tactuator.signals.record import Response
from tactuator.synthesis.felt import felt_db_sl

Mode = Literal["idle", "live", "listening", "measuring", "presenting", "fault", "gone"]
_ERRORS = ("error_db", "error_jnd", "model_db", "unpredicted_db")


@dataclass(frozen=True)
class MeasureSettings(MeasurementOptions, PageSetting):
    """Settings of a measurement, as `measure response` has them; no frequencies: those of the command."""

    frequency_hz: Annotated[tuple[Hertz, ...], Field(max_length=200)] = ()


@dataclass(frozen=True)
class ListenSettings(PageSetting):
    """Settings of live sound. file: path of a sound file, or its key as a page names it; empty: a microphone, by its
    name or the system's own.
    """

    coding: Name
    level_db_sl: Finite
    file: Name = ""
    microphone: Name = ""


@dataclass(frozen=True)
class RigStatus:
    """Status of the rig, sent by its process whenever something of it has changed.

    guard: of a board, its mode and fault as words; else empty. loaded: hash of the controller. fed:
    rows of reference that the rig has asked for; given_back: rows of trace that it has returned. refused: it has gone
    because what was asked for is bad input, and not because a device failed.
    """

    mode: Mode = "idle"
    fault: str = ""
    loaded: str = ""
    wave: GeneratorWave | None = None
    touch: dict[str, str | None] = field(default_factory=dict)
    press_v: dict[str, float] = field(default_factory=dict)
    guard: dict[str, Any] = field(default_factory=dict)
    touchable: bool = False
    fed: int = 0
    given_back: int = 0
    gaps: int = 0
    refused: bool = False


@dataclass(frozen=True)
class Points:
    """A measurement so far: the document of its responses, what of it is over, and the response file (CSV)."""

    document: dict[str, Any]
    done: int
    total: int
    csv: str
    over: bool = False

    @classmethod
    def of(cls, responses: tuple[Response, ...], controller: Controller, settings: MeasureSettings, over: bool) -> Self:
        """Return what a page shows of responses, and the file that `measure --out response.csv` would write of them."""
        levels = [ResponseLevels.of(response, controller) for response in responses]
        channels = [controller.display.channel(response.channel) for response in responses]
        shown = [
            {
                **picked(response, "channel", "load", asked_db_sl="level_db_sl"),
                **{name: getattr(response, name).tolist() for name in ("frequency_hz", "saturated", "reached")},
                **{name: _finite(values) for name, values in picked(level, *_ERRORS, level_db_sl="felt_db_sl").items()},
                "worst_first": level.worst_first,
                "confidence_db": _finite(response.confidence_db),
                "noise_db_sl": _finite(felt_db_sl(channel, response.noise_v, response.frequency_hz)),
                "within": _within(response, level),
            }
            for response, level, channel in zip(responses, levels, channels, strict=True)
        ]
        done = len(responses[0].frequency_hz) if responses else 0
        return cls({"responses": shown}, done, len(settings.frequency_hz), responses_csv(responses), over)


@dataclass(frozen=True, eq=False)
class Presented:
    """A piece of what an experiment plays by the call of that number, or its end (over).

    began_at, rows_played: of a rig that reports its time, else None. halted: it was stopped; fault: why the rig did;
    missed: and the same may be asked for again.
    """

    number: int
    trace: Trace | None = None
    began_at: int | None = None
    rows_played: int | None = None
    over: bool = False
    halted: bool = False
    fault: str = ""
    missed: bool = False


def _within(response: Response, levels: ResponseLevels) -> str:
    greatest, (low, high) = np.max(np.abs(levels.error_db)), np.sort(response.frequency_hz)[[0, -1]]
    return f"felt within {greatest:.2f} dB of {response.level_db_sl:g} dB SL from {low:.4g} to {high:.4g} Hz"


def _finite(values: FloatArray) -> list[float | None]:
    """Return numbers as JSON has them: None for a level of nothing (a constant reading) or no confidence."""
    return [float(value) if np.isfinite(value) else None for value in values]

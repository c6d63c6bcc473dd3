"""The view Speech: a speech file on the fingers of a display, what is asked of them and what they feel of it."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from tactuator.console.asked import Answer, Finite, Name, ViewRequest
from tactuator.console.workshop import Workshop
from tactuator.measure.felt import LONG_FRAME_S, SHORT_FRAME_S, FingerFelt
from tactuator.speech.coding import coding_names, coding_of
from tactuator.speech.options import LEVEL_DB_SL
from tactuator.speech.reading import scan_speech
from tactuator.speech.render import RenderJob, render_file

_REFERENCE, _FELT = "reference.wav", "felt.wav"
_SHOWN_S = 30.0


class SpeechRendered(ViewRequest):
    """Request to code a speech file onto the fingers of a display, and to feel it on the simulated one."""

    do: Literal["speech.render"]
    display: Name
    file: Name
    coding: Name = "direct"
    level: Annotated[Finite, Field(ge=-20.0, le=60.0)] = LEVEL_DB_SL

    def answer(self, workshop: Workshop) -> Answer:
        """Return levels asked and felt in bands, by finger and over time, the limiter's figures, and the files' key."""
        speech = workshop.drawer.path(self.file)
        scan_speech(speech)  # what is no sound is told before a controller is designed
        controller = workshop.own_controller(self.display)
        job = RenderJob(
            controller, coding_of(self.coding if self.coding in coding_names() else "?"), self.level, simulate=True
        )
        key, place = workshop.drawer.place()
        made = render_file(speech, place / _REFERENCE, job, place / _FELT)
        workshop.drawer.keep(key, place / _REFERENCE)
        assert made.felt is not None
        figures = made.felt.figures()
        return {
            "key": key,
            "files": [_REFERENCE, Path(_REFERENCE).with_suffix(".json").name, _FELT],
            "duration_s": made.frames / made.rate_hz,
            "shown_s": _SHOWN_S,
            "peak_db_sl": max(made.peak_db_sl.values()),
            "notes": list(made.speech.notes),
            "fingers": [_finger(one) for one in made.felt.fingers],
            "rows": [
                [
                    one.finger,
                    f"{made.peak_db_sl[one.finger]:.1f}",
                    f"{one.max_reduction_db:.1f}",
                    *(f"{figures[one.finger][name]:.2f}" for name in ("rms_db", "median_db_all", "p95_db_all")),
                ]
                for one in made.limiting
            ],
            "command": self.command(workshop, speech),
            "play": shlex.join(["tactuator", "play", _REFERENCE, "--display", workshop.command_name(self.display)]),
        }

    def command(self, workshop: Workshop, speech: Path) -> str:
        """Return the command line that writes the same files."""
        words = ["tactuator", "render", speech.name, "--display", workshop.command_name(self.display)]
        words += ["--coding", self.coding, "--level", f"{self.level:g}", "--out", _REFERENCE, "--felt", _FELT]
        return shlex.join(words)


class SpeechCodings(ViewRequest):
    """Request for the names of the codings, and the level that is usual."""

    do: Literal["speech.codings"]

    def answer(self, workshop: Workshop) -> Answer:
        """Return the names, and the level in dB SL."""
        return {"codings": list(coding_names()), "level": LEVEL_DB_SL}


SpeechRequest = SpeechRendered | SpeechCodings


def _finger(one: FingerFelt) -> Answer:
    parts = []
    first = 0
    for seconds, asked, felt in (
        (LONG_FRAME_S, one.asked_long, one.felt_long),
        (SHORT_FRAME_S, one.asked_short, one.felt_short),
    ):
        frames = min(len(asked), round(_SHOWN_S / seconds))
        bands = one.centre_hz[first : first + asked.shape[1]]
        first += asked.shape[1]
        parts.append(
            {
                "seconds": seconds,
                "hz": _tenths(bands, 3),
                "asked": _tenths(asked[:frames]),
                "felt": _tenths(felt[:frames]),
            }
        )
    return {
        "name": one.finger,
        "hz": _tenths(one.centre_hz, 3),
        "asked": _tenths(one.asked_db_sl),
        "felt": _tenths(one.felt_db_sl),
        "difference": _tenths(one.difference_db),
        "parts": parts,
    }


def _tenths(values: Any, decimals: int = 1) -> Any:
    """Return numbers as lists, rounded; None where there is none."""
    array = np.asarray(values, dtype=float)
    if array.ndim > 1:
        return [_tenths(row, decimals) for row in array]
    return [round(one, decimals) if np.isfinite(one) else None for one in array.tolist()]

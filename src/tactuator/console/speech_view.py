"""The view Speech: a speech file on the fingers of a display, what is asked of them and what they feel of it."""

from __future__ import annotations

from pathlib import Path

from tactuator.api.speech import RenderResult, render
from tactuator.console.fields import Finite, Name
from tactuator.console.requests import Answer, View, command_line, tenths
from tactuator.console.rig_session import expected_hum
from tactuator.console.state import ConsoleState
from tactuator.measure.felt import LONG_FRAME_S, SHORT_FRAME_S, FingerFelt
from tactuator.perception.curve import check_level
from tactuator.speech.coding import coding_names
from tactuator.speech.options import CODING, LEVEL_DB_SL
from tactuator.speech.reading import scan_speech

_REFERENCE, _FELT = "reference.wav", "felt.wav"
_SHOWN_S = 30.0


def rendered(
    state: ConsoleState, display: Name, file: Name, coding: Name = CODING, level: Finite = LEVEL_DB_SL
) -> Answer:
    """Code a speech file onto the fingers of a display, and feel it on the simulated one; return levels asked and felt
    in bands, by finger and over time, the limiter's figures, and the files' key.
    """
    speech = state.uploads.path(file)
    scan_speech(speech)  # a file that is no sound is refused before a controller is designed
    check_level(level)
    controller = state.file_controller(display)
    known = coding if coding in coding_names() else "?"  # a file of the server is none of the page's
    key, folder = state.uploads.new_folder()
    result = render(speech, controller, folder / _REFERENCE, known, level, felt=folder / _FELT)
    state.uploads.keep(key, folder / _REFERENCE)
    assert isinstance(result, RenderResult)
    made = result.rendered
    assert made.felt is not None
    figures = made.felt.figures()
    hum = {channel.name: expected_hum(controller, channel) for channel in controller.display.channels}
    return {
        "key": key,
        "files": [_REFERENCE, Path(_REFERENCE).with_suffix(".json").name, _FELT],
        "duration_s": made.frames / made.rate_hz,
        "shown_s": _SHOWN_S,
        "peak_db_sl": max(made.peak_db_sl.values()),
        "notes": list(made.notes),
        "fingers": [_finger(finger) | {"hum": hum[finger.finger]} for finger in made.felt.fingers],
        "hum": _hum_said([line for lines in hum.values() for line in zip(*lines.values(), strict=True)]),
        "rows": [
            [
                limiting.finger,
                f"{made.peak_db_sl[limiting.finger]:.1f}",
                f"{limiting.max_reduction_db:.1f}",
                *(f"{figures[limiting.finger][name]:.2f}" for name in ("rms_db", "median_db_all", "p95_db_all")),
            ]
            for limiting in made.limiting
        ],
        "command": command_line(
            "render",
            speech.name,
            display=state.command_name(display),
            coding=coding,
            level=level,
            out=_REFERENCE,
            felt=_FELT,
        ),
        "play": command_line("play", _REFERENCE, display=state.command_name(display)),
    }


def codings(state: ConsoleState) -> Answer:
    """Return the names of the codings, and the level that is usual, dB SL."""
    return {"codings": list(coding_names()), "level": LEVEL_DB_SL}


VIEW = View("speech", "Speech", {"render": rendered, "codings": codings}, of_display=True)


def _hum_said(lines: list[tuple[float, float]]) -> str:
    """Return what the mains hum does to the felt levels, in words; lines: frequency and level of each."""
    if not lines:
        return ""
    hertz, level = max(lines, key=lambda line: line[1])
    feels = "is felt" if level > 0.0 else "is below the threshold"
    return (
        f"Where felt rises above asked near {hertz:g} Hz, it is the mains hum of the display itself, which the loop "
        f"hands on to the finger: at most {level:.1f} dB SL by the model, which {feels}."
    )


def _finger(felt: FingerFelt) -> Answer:
    parts = []
    first = 0
    for seconds, asked_db, felt_db in (
        (LONG_FRAME_S, felt.asked_long, felt.felt_long),
        (SHORT_FRAME_S, felt.asked_short, felt.felt_short),
    ):
        frames = min(len(asked_db), round(_SHOWN_S / seconds))
        bands = felt.centre_hz[first : first + asked_db.shape[1]]
        first += asked_db.shape[1]
        parts.append(
            {
                "seconds": seconds,
                "hz": tenths(bands, 3),
                "asked": tenths(asked_db[:frames]),
                "felt": tenths(felt_db[:frames]),
            }
        )
    return {
        "name": felt.finger,
        "hz": tenths(felt.centre_hz, 3),
        "asked": tenths(felt.asked_db_sl),
        "felt": tenths(felt.felt_db_sl),
        "difference": tenths(felt.difference_db),
        "parts": parts,
    }

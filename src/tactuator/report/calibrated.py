"""The files of a calibrated display without loop: display file, equalisers for other programs, and a page for a methods
section.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import AbstractContextManager
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import scipy
import soundfile

from tactuator import __version__
from tactuator.arrays import FloatArray
from tactuator.io.atomic import atomic_folder
from tactuator.io.controller import write_controller
from tactuator.io.model import write_model
from tactuator.io.record import write_record
from tactuator.io.text import toml_text
from tactuator.measure.error import ChannelPrediction
from tactuator.measure.open_loop import Calibrated, CalibratedChannel, CalibrationRequest, Flatness, NoEqualiser
from tactuator.model.controller import ChannelController, Controller
from tactuator.model.description import Display, display_document
from tactuator.signals.decibels import db
from tactuator.signals.record import Record

_ENDS = {"asked": "the end of what was asked", "command": "the command's range", "travel": "the travel"}


def open_loop_page(calibrated: Calibrated, asked: CalibrationRequest, rig: str, date: str, gaps: int) -> str:
    """Return the page as Markdown."""
    controller = calibrated.controller
    display = controller.display
    template = Template(files("tactuator.report").joinpath("calibrated.md").read_text("utf-8"))
    reported = f"{gaps} gaps; every run with one was repeated" if gaps else "no gap"
    return template.substitute(
        display=display.name,
        version=__version__,
        date=date,
        rig=rig,
        rate_hz=f"{display.rate_hz:g}",
        controller=controller.content_hash[:12],
        felt="felt levels are" if len(calibrated.channels) > 1 else "the felt level is",
        outcome="within" if calibrated.flat else "NOT within",
        flatness_db=f"{display.objectives.flatness_db:g}",
        channels="\n".join(line for channel in calibrated.channels for line in _channel(channel, controller, asked)),
        low_hz=f"{asked.band_hz[0]:g}",
        high_hz=f"{asked.band_hz[1]:g}",
        level_db_sl=f"{asked.level_db_sl:g}",
        gaps=f"The card reported {reported}.",
    )


def _channel(calibrated: CalibratedChannel, controller: Controller, asked: CalibrationRequest) -> list[str]:
    channel = controller.display.channel(calibrated.name)
    low, high = calibrated.usable.band_hz
    last, plant, level = calibrated.last, calibrated.estimate.plant, calibrated.level
    off_db = max(0.0, calibrated.estimate.departure_db)
    card = controller.display.sound
    assert card is not None
    wires = card.wires[controller.display.channels.index(channel)]
    put_back_ms = 1e3 * card.latency_samples / controller.rate_hz
    rows = {
        "threshold curve": f"{channel.threshold.curve.name} ({channel.threshold.curve.provenance})",
        "usable band": f"{low:.4g} to {high:.4g} Hz at {asked.level_db_sl:g} dB SL "
        f"(ended by {_ENDS[calibrated.usable.ends[0]]} and by {_ENDS[calibrated.usable.ends[1]]})",
        "felt level less asked": f"{last.error_db.min():+.2f} to {last.error_db.max():+.2f} dB at "
        f"{last.frequency_hz.size} frequencies (95 %: ±{last.confidence_db.max():.2f} dB or better)",
        "by octave": "; ".join(_by_octave(calibrated.last)),
        "corrected at that level": f"{calibrated.rounds} times (first {calibrated.first.worst_db:+.2f} dB)"
        if calibrated.rounds
        else "not needed",
        "plant": f"{_PLANTS[calibrated.estimate.by]}, {plant.poles.size} poles; within {off_db:.2f} dB of fresh noise",
        "dead time": f"{put_back_ms:.3f} ms put back (latency_samples = {card.latency_samples}), card included; "
        f"{1e3 * channel.plant.delay_s:.3f} ms left in the plant",
        "recorded at": f"{level.volts:.3g} V peak, {1e3 * level.moved_mm:.3g} µm peak (bound by {level.bound_by})",
        "sensor": f"{channel.quantity}, {channel.sensor_gain_v_per_mm:g} V per mm{_PER[channel.quantity]}",
        "card": f"output {wires.output} at {wires.output_full_scale_v:g} V full scale, input {wires.input} at "
        f"{wires.input_full_scale_v:g} V",
        "limits": f"{channel.converter.range_v:g} V, {channel.travel_mm:g} mm, "
        f"{controller.display.objectives.comfort_db_sl:g} dB SL",
    }
    short = calibrated.shortfall(controller.display.objectives.flatness_db)
    rows = {"not flat": short, **rows} if short else rows
    return [
        f"## {calibrated.name}",
        "",
        "| what | value |",
        "|---|---|",
        *(f"| {k} | {v} |" for k, v in rows.items()),
        "",
    ]


def _by_octave(flat: Flatness) -> list[str]:
    octave = np.argmin(np.abs(np.log(flat.frequency_hz[:, None] / np.array(_OCTAVES))), axis=1)
    return [
        f"{_OCTAVES[number]:g} Hz {flat.error_db[octave == number].min():+.2f} to "
        f"{flat.error_db[octave == number].max():+.2f}"
        for number in np.unique(octave)
    ]


_OCTAVES = (1.0, 2.0, 4.0, 8.0, 16.0, 31.5, 63.0, 125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0)
_PLANTS = {"model": "model", "response": "the response by itself, as no model is within 1 dB"}
_PER = {"displacement": "", "velocity": "/s", "acceleration": "/s²"}


FILES = ("display.toml", "controller.json", "report.md", "equaliser.json", "response.json")
_OF_A_CHANNEL = ("equaliser.wav", "model.json", "record.h5")


def calibrated_folder(out: Path, display: Display) -> AbstractContextManager[Path]:
    """Return the context of an empty folder for what is written here, which takes the place of `out` at its end.

    Raises BadInput for a folder that holds anything else.
    """
    of_channels = {f"{channel.name}.{ending}" for channel in display.channels for ending in _OF_A_CHANNEL}
    return atomic_folder(out, frozenset({*FILES, *of_channels}))


def write_calibrated(
    folder: Path, calibrated: Calibrated, asked: CalibrationRequest, rig: str, date: str, gaps: int
) -> None:
    """Write FILES into `folder`, and each channel's NAME.equaliser.wav and, where there is a model, NAME.model.json."""
    controller = calibrated.controller
    rate_hz = controller.rate_hz
    (folder / "display.toml").write_text(toml_text(display_document(controller.display)), encoding="utf-8")
    write_controller(folder / "controller.json", controller)
    (folder / "report.md").write_text(open_loop_page(calibrated, asked, rig, date, gaps), encoding="utf-8")
    equalisers = []
    for channel, designed in zip(calibrated.channels, controller.channels, strict=True):
        if channel.estimate.model is not None:
            write_model(folder / f"{channel.name}.model.json", channel.estimate.model)
        impulse, volts = impulse_response(designed, rate_hz)
        wave_path = folder / f"{channel.name}.equaliser.wav"
        soundfile.write(wave_path, impulse, round(rate_hz), subtype="FLOAT", format="WAV")
        wave = {"file": wave_path.name, "volts_of_1": volts}
        equalisers.append(equaliser_document(designed, rate_hz) | {"impulse_response": wave})
    _write_json(folder / "equaliser.json", {"channels": equalisers})
    responses = [response_document(controller, channel.name) for channel in calibrated.channels]
    _write_json(folder / "response.json", {"channels": responses})


def write_measured(folder: Path, reached: NoEqualiser, rig: str, date: str) -> tuple[str, ...]:
    """Write what was measured before there was no equaliser, and return the files' names: display.toml with the plants
    that were found, and each channel's NAME.record.h5 and, where there is a model, NAME.model.json.
    """
    names = ["display.toml"]
    (folder / "display.toml").write_text(toml_text(display_document(reached.display)), encoding="utf-8")
    for known in reached.known:
        name, recording = known.channel.name, known.recording
        about = {"rig": rig, "channel": name, "display": reached.display.name, "hold": "band-limited", "date": date}
        record = Record(recording.wave.rate_hz, recording.command.ravel(), recording.position.ravel(), about=about)
        write_record(folder / f"{name}.record.h5", record)
        names.append(f"{name}.record.h5")
        if known.estimate.model is not None:
            write_model(folder / f"{name}.model.json", known.estimate.model)
            names.append(f"{name}.model.json")
    return tuple(names)


def _write_json(path: Path, document: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


_QUIET, _LONGEST_S, _FADE = 1e-4, 1.0, 0.1
_POINTS = 121


def impulse_response(designed: ChannelController, rate_hz: float) -> tuple[FloatArray, float]:
    """Return a channel's equaliser as an impulse response (n,) with a peak of 1, and the volts at that peak for a
    threshold unit; its last tenth is faded out, where it is 80 dB below the peak or a second has gone.
    """
    impulse = np.zeros(round(_LONGEST_S * rate_hz))
    impulse[0] = 1.0
    sections = designed.prefilter_sos / designed.prefilter_sos[:, 3:4]
    answer = scipy.signal.sosfilt(sections, impulse)
    peak = float(np.max(np.abs(answer)))
    end = int(np.flatnonzero(np.abs(answer) > _QUIET * peak)[-1]) + 1
    count = min(impulse.size, max(64, round(end / (1.0 - _FADE))))
    line = np.ones(count)
    fade = max(1, round(_FADE * count))
    line[-fade:] = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, fade + 1) / fade)
    return answer[:count] * line / peak, peak


def equaliser_document(designed: ChannelController, rate_hz: float) -> dict[str, Any]:
    """Return a channel's equaliser as second-order sections, b0 b1 b2 a0 a1 a2, with what it maps and its limit."""
    return {
        "channel": designed.name,
        "rate_hz": rate_hz,
        "maps": "threshold units (1: 0 dB SL) to volts at the motor",
        "sections": designed.prefilter_sos.tolist(),
        "columns": ["b0", "b1", "b2", "a0", "a1", "a2"],
        "command_limit_v": designed.limits.command_v,
    }


def response_document(controller: Controller, name: str) -> dict[str, Any]:
    """Return a channel's model over its band: mm for a volt, and the level error under the equaliser."""
    prediction = ChannelPrediction.of(controller, name)
    low, high = prediction.channel.threshold.band_hz
    frequency = np.geomspace(low, high, _POINTS)
    moved = prediction.displacement(frequency) / prediction.command(frequency)
    return {
        "channel": name,
        "frequency_hz": frequency.tolist(),
        "mm_per_v": np.abs(moved).tolist(),
        "threshold_db_re_1um": db(1e3 * prediction.channel.threshold.curve.displacement_mm(frequency)).tolist(),
        "felt_error_db": db(np.abs(prediction.felt(frequency))).tolist(),
    }

"""One page on a calibrated display without loop: every figure that a methods section needs."""

from __future__ import annotations

import numpy as np

from tactuator import __version__
from tactuator.measure.open_loop.chain import Calibrated, CalibratedChannel, CalibrationRequest
from tactuator.measure.open_loop.flatness import Flatness
from tactuator.model.controller import Controller

_ENDS = {
    "asked": "the end of what was asked",
    "command": "the command's range",
    "travel": "the travel",
}


def open_loop_page(made: Calibrated, asked: CalibrationRequest, rig: str, date: str, gaps: int) -> str:
    """Return the page as Markdown."""
    controller = made.controller
    display = controller.display
    outcome = "within" if made.flat else "NOT within"
    felt = "felt levels are" if len(made.channels) > 1 else "the felt level is"
    lines = [
        f"# {display.name}: calibration without loop",
        "",
        f"tactuator {__version__}, {date}, on `{rig}` at {display.rate_hz:g} Hz. "
        f"Controller {controller.content_hash[:12]}. "
        f"By its own sensor {felt} {outcome} ±{display.objectives.flatness_db:g} dB over the usable band.",
        "",
        *(line for one in made.channels for line in _channel(one, controller, asked)),
        "## How it was found",
        "",
        "Each channel was driven with a broadband periodic command (4 s; lines from half the lower to 1.6 times the "
        f"upper frequency asked, {asked.band_hz[0]:g} to {asked.band_hz[1]:g} Hz; amplitudes as 1/f), raised until 19 "
        "of 20 lines stood 30 dB above the noise. A model was fitted to five periods and held against two of another "
        f"command. The usable band is that in which a tone of {asked.level_db_sl:g} dB SL needs at most 0.9 of the "
        "range and of the travel. The equaliser was verified at the sensor with tones of that level, several at a "
        "time, of which the loudest alone, against the threshold curve; an equaliser that erred by more than 0.7 of "
        "the tolerance was corrected by that and verified anew. "
        + (f"The card told of {gaps} gaps; every run with one was repeated." if gaps else "The card told of no gap."),
        "",
        "## What the figures do not hold",
        "",
        "They are as true as the sensor's calibration and the curve. They hold for the actuator as it stood; a finger "
        "that touches it is a load, under which it has to be measured again. Tones of other levels are felt as flat as "
        "the actuator is linear.",
        "",
    ]
    return "\n".join(lines)


def _channel(one: CalibratedChannel, controller: Controller, asked: CalibrationRequest) -> list[str]:
    channel = controller.display.channel(one.name)
    low, high = one.usable.band_hz
    last, plant, level = one.last, one.followed.plant, one.level
    off_db = max(0.0, one.followed.departure_db)
    card = controller.display.sound
    assert card is not None
    wires = card.wires[controller.display.channels.index(channel)]
    put_back_ms = 1e3 * card.latency_samples / controller.rate_hz
    rows = {
        "threshold curve": f"{channel.threshold.curve.name} ({channel.threshold.curve.provenance})",
        "usable band": f"{low:.4g} to {high:.4g} Hz at {asked.level_db_sl:g} dB SL "
        f"(ended by {_ENDS[one.usable.ends[0]]} and by {_ENDS[one.usable.ends[1]]})",
        "felt level less asked": f"{last.error_db.min():+.2f} to {last.error_db.max():+.2f} dB at "
        f"{last.frequency_hz.size} frequencies (95 %: ±{last.confidence_db.max():.2f} dB or better)",
        "by octave": "; ".join(_by_octave(one.last)),
        "corrected at that level": f"{one.rounds} times (first {one.first.worst_db:+.2f} dB)"
        if one.rounds
        else "not needed",
        "plant": f"{_PLANTS[one.followed.by]}, {plant.poles.size} poles; within {off_db:.2f} dB of fresh noise",
        "dead time": f"{put_back_ms:.3f} ms put back (latency_samples = {card.latency_samples}), card included; "
        f"{1e3 * channel.plant.delay_s:.3f} ms left in the plant",
        "recorded at": f"{level.volts:.3g} V peak, {1e3 * level.moved_mm:.3g} µm peak (bound by {level.bound_by})",
        "sensor": f"{channel.quantity}, {channel.sensor_gain_v_per_mm:g} V per mm{_PER[channel.quantity]}",
        "card": f"output {wires.output} at {wires.output_full_scale_v:g} V full scale, input {wires.input} at "
        f"{wires.input_full_scale_v:g} V",
        "limits": f"{channel.converter.range_v:g} V, {channel.travel_mm:g} mm, "
        f"{controller.display.objectives.comfort_db_sl:g} dB SL",
    }
    short = one.shortfall(controller.display.objectives.flatness_db)
    rows = {"not flat": short, **rows} if short else rows
    return [f"## {one.name}", "", "| what | value |", "|---|---|", *(f"| {k} | {v} |" for k, v in rows.items()), ""]


def _by_octave(flat: Flatness) -> list[str]:
    """Return the least and the greatest error of each octave band."""
    octave = np.argmin(np.abs(np.log(flat.frequency_hz[:, None] / np.array(_OCTAVES))), axis=1)
    return [
        f"{_OCTAVES[number]:g} Hz {flat.error_db[octave == number].min():+.2f} to "
        f"{flat.error_db[octave == number].max():+.2f}"
        for number in np.unique(octave)
    ]


_OCTAVES = (1.0, 2.0, 4.0, 8.0, 16.0, 31.5, 63.0, 125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0)
_PLANTS = {"model": "model", "response": "the response by itself, as no model followed within 1 dB"}
_PER = {"displacement": "", "velocity": "/s", "acceleration": "/s²"}

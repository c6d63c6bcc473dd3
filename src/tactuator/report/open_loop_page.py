"""One page on a calibrated display without loop: every figure that a methods section needs."""

from __future__ import annotations

from tactuator import __version__
from tactuator.display.controller import Controller
from tactuator.measure.open_loop.chain import Calibrated, CalibratedChannel, CalibrationRequest

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
    lines = [
        f"# {display.name}: calibration without loop",
        "",
        f"tactuator {__version__}, {date}, on `{rig}` at {display.rate_hz:g} Hz. "
        f"Controller {controller.content_hash[:12]}. "
        f"Felt levels are {outcome} ±{display.objectives.flatness_db:g} dB over the stated bands.",
        "",
        *(line for one in made.channels for line in _channel(one, controller, asked)),
        "## How it was found",
        "",
        "Each channel was driven with a broadband periodic command (4 s; lines from half the lower to 1.6 times the "
        f"upper frequency asked, {asked.band_hz[0]:g} to {asked.band_hz[1]:g} Hz; amplitudes as 1/f), raised until 19 "
        "of 20 lines stood 30 dB above the noise. A model was fitted to five periods and held against two of another "
        f"command. The usable band is that in which a tone of {asked.level_db_sl:g} dB SL needs at most 0.9 of the "
        "range and of the travel. The equaliser was verified at the sensor with tones of that level, several at a "
        f"time, against the threshold curve. Gaps told by the card: {gaps}; runs with one were repeated.",
        "",
    ]
    return "\n".join(lines)


def _channel(one: CalibratedChannel, controller: Controller, asked: CalibrationRequest) -> list[str]:
    channel = controller.display.channel(one.name)
    low, high = one.usable.band_hz
    last, plant, level = one.last, one.followed.plant, one.level
    off_db = max(0.0, one.followed.departure_db)
    rows = {
        "threshold curve": f"{channel.threshold.curve.name} ({channel.threshold.curve.provenance})",
        "usable band": f"{low:.4g} to {high:.4g} Hz at {asked.level_db_sl:g} dB SL "
        f"(ended by {_ENDS[one.usable.ends[0]]} and by {_ENDS[one.usable.ends[1]]})",
        "felt level less asked": f"{last.error_db.min():+.2f} to {last.error_db.max():+.2f} dB at "
        f"{last.frequency_hz.size} frequencies (95 %: ±{last.confidence_db.max():.2f} dB or better)",
        "before correction at that level": f"{one.first.worst_db:+.2f} dB; corrected {one.rounds} times",
        "plant": f"{one.followed.by}, {plant.poles.size} poles, dead time {1e3 * plant.delay_s:.3g} ms; "
        f"within {off_db:.2f} dB of fresh noise",
        "recorded at": f"{level.volts:.3g} V peak, {1e3 * level.moved_mm:.3g} µm peak (bound by {level.bound_by})",
        "sensor": f"{channel.quantity}, {channel.sensor_gain_v_per_mm:g} V per mm{_PER[channel.quantity]}",
        "limits": f"{channel.converter.range_v:g} V, {channel.travel_mm:g} mm, "
        f"{controller.display.objectives.comfort_db_sl:g} dB SL",
    }
    return [f"## {one.name}", "", "| what | value |", "|---|---|", *(f"| {k} | {v} |" for k, v in rows.items()), ""]


_PER = {"displacement": "", "velocity": "/s", "acceleration": "/s²"}

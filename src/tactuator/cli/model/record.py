"""The verb `record`: a record of one channel under an excitation, from any rig."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, working, written
from tactuator.display.description import Channel
from tactuator.errors import BadInput
from tactuator.files.display import read_display
from tactuator.files.record import write_record
from tactuator.rig.open import open_rig
from tactuator.signals.excitation import log_chirp, noise, paper_mix, plan_amplitude, prbs, sample_count, steps
from tactuator.signals.multisine import multisine, place_lines
from tactuator.signals.record import Record

EXCITATIONS = ("mix", "steps", "noise", "prbs", "chirp", "multisine")


def run(
    display: Path,
    channel: str | None,
    out: Path,
    duration_s: float,
    excitation: str,
    travel_share: float,
    load: str,
    rig: str,
    seed: int,
    as_json: bool,
) -> None:
    """Drive one channel with an excitation planned within travel and range, and write the record."""
    described = read_display(display)
    chosen = described.channel(channel or described.channels[0].name)
    command = planned(excitation, chosen, described.rate_hz, duration_s, travel_share, seed)
    with open_rig(rig, described, seed) as opened:
        if load != "none":
            touch = getattr(opened, "finger", None)
            chosen.load(load)
            if touch is not None:
                touch(chosen.name).touch(load)
        everything = np.zeros((command.size, len(opened.channels)))
        column = opened.channels.index(chosen.name)
        everything[:, column] = command
        with working(f"recording {duration_s:g} s"):
            trace = opened.drive(everything)
            opened.rest()
    about = {"rig": rig, "channel": chosen.name, "load": load, "display": described.name, "excitation": excitation}
    # a sound card's converters are band-limited, every other rig's hold the command between its samples
    about["hold"] = "band-limited" if rig.startswith("sound:") else "zero-order"
    if rig != "simulated":
        about["date"] = datetime.now(UTC).isoformat(timespec="seconds")
    position = trace.position_v[:, column]
    write_record(out, Record(trace.rate_hz, trace.command_v[:, column], position, about=about))
    result = {
        "record": str(out),
        "channel": chosen.name,
        "duration_s": command.size / trace.rate_hz,
        "rate_hz": trace.rate_hz,
        "command_peak_v": float(np.max(np.abs(command))),
        "position_peak_v": float(np.max(np.abs(position))),
        "saturated": bool(np.any(trace.saturated[:, column])),
    }
    answer(result, as_json, Group(_table(result), *written(out)))


def _table(result: Mapping[str, Any]) -> Table:
    table = Table("what", "value", title=f"Record of {result['channel']}")
    table.add_row("duration (s)", f"{result['duration_s']:g}")
    table.add_row("sampling rate (Hz)", f"{result['rate_hz']:g}")
    table.add_row("greatest command (V)", f"{result['command_peak_v']:.2f}")
    table.add_row("greatest position (V of the sensor)", f"{result['position_peak_v']:.3f}")
    table.add_row("a converter reached its limit", "yes" if result["saturated"] else "no")
    return table


def planned(
    excitation: str, channel: Channel, rate_hz: float, duration_s: float, travel_share: float, seed: int
) -> NDArray[np.float64]:
    """Return the command (n,), volts: as large as the share of travel and 0.9 of the range allow by the display's
    plant.
    """
    if excitation not in EXCITATIONS:
        raise BadInput(f"excitation {excitation!r}; allowed: {', '.join(EXCITATIONS)}")
    if not 0.0 < travel_share <= 1.0:
        raise BadInput(f"travel share is {travel_share:g}; allowed: above 0, at most 1")
    rng = np.random.default_rng(seed)
    low, high = channel.threshold.band_hz
    travel_v = travel_share * channel.travel_mm * channel.sensor_gain_v_per_mm
    range_v = channel.converter.range_v
    if excitation == "mix":
        band = (low, min(high, 0.4 * rate_hz))
        return paper_mix(duration_s, rate_hz, range_v, rng, plant=channel.plant, travel_v=travel_v, band_hz=band)
    if excitation == "steps":
        shape = steps(duration_s, rate_hz, min(1.3, 0.1 * duration_s), rng)
    elif excitation == "noise":
        shape = noise(duration_s, rate_hz, (low, 1.2 * high), rng)
    elif excitation == "prbs":
        shape = prbs(duration_s, rate_hz, min(2.5 * high, rate_hz), rng)
    elif excitation == "chirp":
        shape = log_chirp(duration_s, rate_hz, low, high)
    else:
        period = round(rate_hz / low)
        bins = place_lines(np.geomspace(low, high, 40), rate_hz, period)
        made = multisine(rate_hz, period, bins, 1.0, rng)
        count = sample_count(duration_s, rate_hz)
        shape = made.samples(-(-count // period))[:count]
    return plan_amplitude(shape, rate_hz, channel.plant, travel_v, 0.9 * range_v) * shape

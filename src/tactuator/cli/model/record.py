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
from tactuator.errors import BadInput
from tactuator.io.display import read_display
from tactuator.io.record import write_record
from tactuator.model.description import Channel
from tactuator.rig.open import open_rig
from tactuator.rig.rig import Rig, require_sensors
from tactuator.signals.excitation import log_chirp, noise, paper_mix, plan_amplitude, prbs, sample_count, steps
from tactuator.signals.multisine import Periods, multisine, odd_lines
from tactuator.signals.record import Record

EXCITATIONS = ("mix", "steps", "noise", "prbs", "chirp", "multisine")
_LINES = 160


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
    periods: int,
    realisations: int,
    as_json: bool,
) -> None:
    """Drive one channel with an excitation planned within travel and range, and write the record."""
    described = read_display(display)
    chosen, plan = described.channel(channel or described.channels[0].name), dict[str, str]()
    asked = (chosen, described.rate_hz, duration_s, travel_share, seed)
    if excitation == "multisine":
        command, plan = planned_multisine(*asked, (periods, realisations))
    else:
        command = planned(excitation, *asked)
    with open_rig(rig, described, seed) as opened:
        require_sensors(opened, [chosen.name])
        if load != "none":
            _put(chosen.load(load).name, chosen.name, opened)
        everything = np.zeros((command.size, len(opened.channels)))
        column = opened.channels.index(chosen.name)
        everything[:, column] = command
        with working(f"recording {duration_s:g} s"):
            trace = opened.drive(everything)
            opened.rest()
    about = {"rig": rig, "channel": chosen.name, "load": load, "display": described.name, "excitation": excitation}
    # a sound card's converters are band-limited, every other rig's hold the command between its samples
    about |= plan | {"hold": "band-limited" if rig.startswith("sound:") else "zero-order"}
    if rig != "simulated":
        about["date"] = datetime.now(UTC).isoformat(timespec="seconds")
    made = Record(trace.rate_hz, trace.command_v[:, column], trace.position_v[:, column], about=about)
    write_record(out, made)
    result = {
        "record": str(out),
        "channel": chosen.name,
        "duration_s": command.size / trace.rate_hz,
        "rate_hz": trace.rate_hz,
        "command_peak_v": float(np.max(np.abs(command))),
        "position_peak_v": float(np.max(np.abs(made.position))),
        "saturated": bool(np.any(trace.saturated[:, column])),
    }
    answer(result, as_json, Group(_table(result), *written(out)))


def _put(load: str, channel: str, rig: Rig) -> None:
    """Put a load on a channel of a rig that has a finger to do it; elsewhere a person does."""
    touch = getattr(rig, "finger", None)
    if touch is not None:
        touch(channel).touch(load)


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
        raise BadInput(f"excitation {excitation!r}", f"{', '.join(EXCITATIONS)}")
    rng = np.random.default_rng(seed)
    low, high = channel.threshold.band_hz
    travel_v = _travel_v(channel, travel_share)
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
    else:
        shape = log_chirp(duration_s, rate_hz, low, high)
    return plan_amplitude(shape, rate_hz, channel.plant, travel_v, 0.9 * range_v) * shape


def planned_multisine(
    channel: Channel,
    rate_hz: float,
    duration_s: float,
    travel_share: float,
    seed: int,
    many: tuple[int, int],
) -> tuple[NDArray[np.float64], dict[str, str]]:
    """Return the command (n,), volts, of several odd multisines of random phases, and what their record has to say.

    many: periods of each multisine, the first of them to settle, and multisines. Lines are the louder the less the
    plant answers (by the root of it). Raises BadInput where a period shows too few lines of the channel's band.
    """
    periods, realisations = many
    travel_v = _travel_v(channel, travel_share)
    if periods < 3 or realisations < 1:
        raise BadInput(f"{realisations} realisations of {periods} periods", "1 or more of 3 or more")
    rng = np.random.default_rng(seed)
    low, high = channel.threshold.band_hz
    period = sample_count(duration_s / (periods * realisations), rate_hz)
    lines = odd_lines((low, min(high, 0.4 * rate_hz)), rate_hz, period, _LINES, rng)
    answer_there = np.abs(channel.plant.response(lines * rate_hz / period))
    peaks = np.sqrt(np.max(answer_there) / np.maximum(answer_there, 1e-4 * np.max(answer_there)))
    made = [multisine(rate_hz, period, lines, peaks, rng, rounds=1).samples(periods) for _ in range(realisations)]
    shape = np.concatenate(made)
    factor = plan_amplitude(shape, rate_hz, channel.plant, travel_v, 0.9 * channel.converter.range_v)
    return factor * shape, Periods(period, periods, realisations, lines).attributes()


def _travel_v(channel: Channel, share: float) -> float:
    """Return a share of the channel's travel, volts of position. Raises BadInput unless it is above 0, at most 1."""
    if not 0.0 < share <= 1.0:
        raise BadInput(f"travel share is {share:g}", "above 0, at most 1")
    return share * channel.travel_mm * channel.sensor_gain_v_per_mm

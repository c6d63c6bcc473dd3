"""The loudest reference of a display at every frequency, and the limit that stops it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tactuator.report.plate import Plate
from tactuator.report.plates.controller.envelope import by_load
from tactuator.report.style import BLUE, GREEN, INK, RED, figure, frequency_axis, legend
from tactuator.synthesis.headroom import Headroom

_COLOURS = {"comfort": GREEN, "command": RED, "travel": BLUE}


def lowest(rooms: Mapping[str, Headroom]) -> dict[str, Headroom]:
    """Return for each load the lowest headroom of all its models, frequency by frequency."""
    found = {}
    for load, names in by_load(list(rooms)).items():
        levels = np.array([rooms[name].level_db_sl for name in names])
        which, columns = np.argmin(levels, axis=0), range(levels.shape[1])
        binding = tuple(rooms[names[row]].binding[column] for row, column in zip(which, columns, strict=True))
        found[load] = Headroom(rooms[names[0]].frequency_hz, levels.min(axis=0), binding)
    return found


def headroom_plate(rooms: Mapping[str, Headroom], name: str = "headroom", title: str = "Headroom") -> Plate:
    """Draw the greatest sinusoidal reference (dB SL) against frequency for each load; colour: the limit that binds."""
    made, axes = figure(height_in=3.6)
    table: dict[str, list[object]] = {"load": [], "frequency_hz": [], "level_db_sl": [], "binding": []}
    seen: set[str] = set()
    for index, (load, room) in enumerate(rooms.items()):
        style = ("-", "--", "-.", ":")[index % 4]
        words = "no load" if load == "none" else load
        axes.plot(room.frequency_hz, room.level_db_sl, color=INK, linewidth=0.9, linestyle=style, label=words, zorder=2)
        for limit, colour in _COLOURS.items():
            bound = np.array([one == limit for one in room.binding])
            if np.any(bound):
                label = None if limit in seen else f"stopped by {limit}"
                seen.add(limit)
                axes.plot(
                    room.frequency_hz[bound], room.level_db_sl[bound], "o", color=colour, markersize=4, label=label
                )
        table["load"] += [load] * room.frequency_hz.size
        table["frequency_hz"] += room.frequency_hz.tolist()
        table["level_db_sl"] += room.level_db_sl.tolist()
        table["binding"] += list(room.binding)
    lowest = min(float(room.level_db_sl.min()) for room in rooms.values())
    axes.set_ylim(min(5.0 * np.floor((lowest - 8.0) / 5.0), 40.0), axes.get_ylim()[1] + 1.0)
    first = next(iter(rooms.values())).frequency_hz
    frequency_axis(axes, float(first[0]), float(first[-1]))
    axes.set_ylabel("greatest level (dB SL)", fontsize=9)
    legend(axes, loc="lower left", ncols=2)
    caption = (
        "The greatest level of one sinusoid before the mechanism's travel, the command's range or comfort stops it; "
        "the colour of a point says which."
    )
    return Plate(name, title, caption, made, table)

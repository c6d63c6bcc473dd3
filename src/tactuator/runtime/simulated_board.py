"""A simulated display as bytes, for boards that have one in the place of converters.

The layout stands in core/display/simulated_board.h.
"""

from __future__ import annotations

import struct
from typing import Any

from tactuator.errors import BadInput
from tactuator.model.description import Display
from tactuator.runtime._core import lib
from tactuator.runtime.image import sealed
from tactuator.runtime.tables import display_table


def simulated_board_bytes(display: Display, seed: int) -> tuple[bytes, tuple[tuple[str | None, ...], ...]]:
    """Return the display for `seed`, and for each channel the names of its loads in the order of the
    board's numbers.
    """
    parts, loads = [], []
    for channel in display.channels:
        table, _keep, names = display_table(channel, display.rate_hz)
        if len(names) > lib.TACT_SIMULATED_BOARD_PLANTS_MAX:
            raise BadInput(
                f"channel {channel.name!r}: {len(names) - 1} loads; "
                f"allowed on an emulated board: at most {lib.TACT_SIMULATED_BOARD_PLANTS_MAX - 1}"
            )
        converter = channel.converter
        parts.append(struct.pack("<iidd", converter.bits, converter.polarity, converter.range_v, converter.offset_v))
        parts.append(_device_bytes(table))
        loads.append(names)
    body = struct.pack("<I", seed) + b"".join(parts)
    head = struct.pack("<4sHHI", b"TACW", 1, len(display.channels), 12 + len(body) + 4)
    content = sealed(head + body)
    if len(content) > lib.TACT_SIMULATED_BOARD_MAX:
        raise BadInput(
            f"the display takes {len(content)} bytes; allowed on an emulated board: {lib.TACT_SIMULATED_BOARD_MAX}"
        )
    return content, tuple(loads)


def _device_bytes(table: Any) -> bytes:
    friction, hum = table.friction, table.hum
    lines = [(hum.cosine[i], hum.sine[i], hum.amplitude_v[i]) for i in range(hum.count)]
    content = struct.pack("<ii", table.dead_time, table.has_late)
    content += struct.pack("<4d", friction.stiffness, friction.per_presliding, table.sensor_v_per_mm, table.noise_v)
    content += struct.pack("<i", hum.count) + b"".join(struct.pack("<3d", *line) for line in lines)
    order = table.plants[0].order
    content += struct.pack("<ii", table.plant_count, order)
    return content + b"".join(_plant_bytes(table.plants[i], order) for i in range(table.plant_count))


def _plant_bytes(plant: Any, order: int) -> bytes:
    numbers = [plant.a[i][j] for i in range(order) for j in range(order)]
    for row in (plant.b, plant.late, plant.sensor, plant.displacement):
        numbers += list(row[0:order])
    return struct.pack(f"<{len(numbers) + 2}d", *numbers, plant.sensor_direct, plant.displacement_direct)

"""The core's tables, filled from a display and from a controller.

Each function returns a cffi struct; what a struct points to must be kept alive by the caller (`keep`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import BadInput
from tactuator.model.controller import ChannelController
from tactuator.model.description import Channel, Converter
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.held_plant import HeldPlant, held_plants
from tactuator.runtime.image import CHANNEL_HEAD, float32_channel


def converter_table(converter: Converter) -> Any:
    """Return the `tact_converter` of a channel."""
    table = ffi.new("tact_converter *")
    lib.tact_converter_make(
        table, converter.bits, converter.range_v, float(converter.polarity), float(converter.offset_v)
    )
    return table


def controller_table(controller: ChannelController) -> Any:
    """Return `tact_controller` of a channel, filled from the bytes of its float32 image.

    The simulated display so runs the very numbers that a board runs; unlike a board it also takes unstable sections,
    to show what they do. Raises BadInput for too many sections, coefficients beyond float32, or a limit that is none.
    """
    body = float32_channel(controller)
    _, prefilters, feedbacks, _, command_v = CHANNEL_HEAD.unpack_from(body)
    words = np.frombuffer(body, dtype="<f4", offset=CHANNEL_HEAD.size)
    table = ffi.new("tact_controller *")
    table.prefilter_count, table.feedback_count = prefilters, feedbacks
    sections = words[4:].reshape(-1, 5)
    _fill_sections(table.prefilter, sections[:prefilters])
    _fill_sections(table.feedback, sections[prefilters:])
    table.anti_windup[0], table.anti_windup[1], table.conditioning, table.reference_max = words[:4].tolist()
    table.command_max_v, table.command_min_v = command_v, -command_v
    if not lib.tact_controller_is_valid(table):
        where = f"controller, channel {controller.name!r}: "
        raise BadInput(f"{where}command_v is {controller.limits.command_v:g}", "a positive number of volts")
    return table


def _fill_sections(sections: Any, coefficients: NDArray[np.float32]) -> None:
    for section, row in zip(sections, coefficients.tolist(), strict=False):
        section.b0, section.b1, section.b2, section.a1, section.a2 = row


def display_table(channel: Channel, rate_hz: float) -> tuple[Any, list[Any], tuple[str | None, ...]]:
    """Return the `tact_display` of a channel, what it points to, and the names of its loads (None first: nothing
    touches).
    """
    held = held_plants(channel, rate_hz)
    plants = ffi.new("tact_plant[]", len(held.plants))
    for table, plant in zip(plants, held.plants, strict=True):
        _fill_plant(table, plant)
    if held.dead_time >= lib.TACT_DEAD_TIME_MAX:
        raise BadInput(
            f"channel {channel.name!r}: dead time is {held.dead_time} samples", f"below {lib.TACT_DEAD_TIME_MAX}"
        )
    display = ffi.new("tact_display *")
    display.plants, display.plant_count = plants, len(held.plants)
    display.dead_time, display.has_late = held.dead_time, int(held.has_late)
    display.converter = converter_table(channel.converter)[0]
    environment = channel.environment
    display.friction.stiffness = environment.friction_v / environment.presliding_v
    display.friction.per_presliding = 1.0 / environment.presliding_v
    display.sensor_v_per_mm = channel.sensor_gain_v_per_mm
    display.noise_v = environment.noise_v_rms / ((2.0**32 - 1.0) / 3.0) ** 0.5
    _fill_hum(display.hum, channel, rate_hz)
    return display, [plants], held.load_names


def _fill_plant(table: Any, plant: HeldPlant) -> None:
    order = plant.b.size
    table.order = order
    for i in range(order):
        table.a[i][0:order] = plant.a[i].tolist()
    for name in ("b", "late", "sensor", "displacement"):
        getattr(table, name)[0:order] = getattr(plant, name).tolist()
    table.sensor_direct, table.displacement_direct = plant.sensor_direct, plant.displacement_direct


def _fill_hum(hum: Any, channel: Channel, rate_hz: float) -> None:
    environment = channel.environment
    lines = [(f, a) for f, a in zip(environment.hum_hz, environment.hum_v_peak, strict=True) if a > 0.0]
    if len(lines) > lib.TACT_HUM_MAX:
        raise BadInput(f"channel {channel.name!r}: {len(lines)} lines of hum", f"at most {lib.TACT_HUM_MAX}")
    hum.count = len(lines)
    for i, (frequency_hz, amplitude_v) in enumerate(lines):
        angle = 2.0 * np.pi * frequency_hz / rate_hz
        hum.cosine[i], hum.sine[i], hum.amplitude_v[i] = np.cos(angle), np.sin(angle), amplitude_v

"""The core's tables, filled from a display and from a controller: structures, or bytes for a simulated board.

Each `..._table` returns a cffi struct, which is not written to; what it points to must be kept alive by the caller.

A plant is held by converters in controller canonical form, y = num(xi) with den(xi) = u: a load changes den alone, so
the states xi, xi', xi'', ... go on when a load is put on or taken off, and with them position and velocity. They are
scaled by powers of a typical pole, which keeps the matrix exponential accurate.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import ChannelController
from tactuator.model.description import Channel, Converter, Display
from tactuator.model.plant import DERIVATIVES
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.image import ImageRefusal, channel_bytes, sealed
from tactuator.signals.discretise import held_matrices, late_input
from tactuator.signals.systems import ContinuousSystem


@dataclass(frozen=True)
class HeldPlant:
    """A plant under a zero-order hold: x(k+1) = a x + b u(k) + late (u(k-1) - u(k)); volts at the sensor and mm at the
    finger are rows times x, plus the direct parts times u. Shapes (n, n) and (n,).
    """

    a: FloatArray
    b: FloatArray
    late: FloatArray
    sensor: FloatArray
    displacement: FloatArray
    sensor_direct: float
    displacement_direct: float


@dataclass(frozen=True)
class HeldPlants:
    """One HeldPlant without load and one for each load of the channel, in that order.

    dead_time: whole samples; has_late: a part of a sample is left, and is in `late`.
    """

    plants: tuple[HeldPlant, ...]
    dead_time: int
    has_late: bool


@dataclass(frozen=True)
class _Canonical:
    """A plant in canonical form: den(xi) = gain u, monic; y = sensor(xi) V, displacement(xi) mm; ascending in s."""

    den: FloatArray
    gain: float
    sensor: FloatArray
    displacement: FloatArray


def held_plants(channel: Channel, rate_hz: float) -> HeldPlants:
    """Return the plants of a channel, held. Raises BadInput for one of too high an order."""
    plants = [channel.plant, *(channel.loaded_plant(load) for load in channel.loads)]
    forms = [_canonical(channel, plant) for plant in plants]
    order = max(form.den.size - 1 for form in forms)
    if not 1 <= order <= lib.TACT_ORDER_MAX:
        raise BadInput(f"channel {channel.name!r}: its plant is of order {order} here", f"1 to {lib.TACT_ORDER_MAX}")
    _check_shared_numerator(channel, forms)
    samples = channel.plant.delay_s * rate_hz
    whole = math.floor(samples + 1e-9)
    fraction = samples - whole if samples - whole > 1e-9 else 0.0
    scale = _typical_pole(forms)
    held = tuple(_hold(form, order, forms[0].gain, scale, rate_hz, fraction) for form in forms)
    return HeldPlants(held, whole, fraction > 0.0)


def _canonical(channel: Channel, plant: ContinuousSystem) -> _Canonical:
    derivatives = DERIVATIVES[channel.quantity]
    at_origin = np.flatnonzero(plant.zeros == 0.0)[:derivatives]
    zeros = np.delete(plant.zeros, at_origin)
    missing = derivatives - at_origin.size  # zeros that the sensor has and the plant has not: integrators
    den = np.real(np.poly(np.append(plant.poles, np.zeros(missing))))[::-1]
    num = np.atleast_1d(np.real(np.poly(zeros)))[::-1]
    sensor = np.append(np.zeros(derivatives), num)
    return _Canonical(den, plant.gain, sensor, num / channel.sensor_gain_v_per_mm)


def _check_shared_numerator(channel: Channel, forms: list[_Canonical]) -> None:
    for form in forms[1:]:
        if form.sensor.shape != forms[0].sensor.shape or not np.allclose(form.sensor, forms[0].sensor, rtol=1e-6):
            raise BadInput(f"channel {channel.name!r}: a load moves the plant's zeros", "loads at the finger")


def _typical_pole(forms: list[_Canonical]) -> float:
    """Return the geometric mean of the poles that are not at the origin, rad/s."""
    poles = np.abs(np.concatenate([np.roots(form.den[::-1]) for form in forms]))
    poles = poles[poles > 1e-9]
    return float(np.exp(np.mean(np.log(poles)))) if poles.size else 1.0


def _hold(
    form: _Canonical, order: int, reference_gain: float, scale: float, rate_hz: float, fraction: float
) -> HeldPlant:
    """Return the held plant in the states xi^(i) / scale^i; xi: of the plant without load, times its gain."""
    order_held = form.den.size - 1
    gain = form.gain / reference_gain
    a = np.eye(order_held, k=1) * scale
    a[-1] -= form.den[:-1] * scale ** (np.arange(order_held) - order_held + 1.0)
    b = np.zeros(order_held)
    b[-1] = gain * scale ** (1.0 - order_held)
    (ad, bd), late = held_matrices(a, b, 1.0 / rate_hz), late_input(a, b, 1.0 / rate_hz, fraction)
    sensor, sensor_direct = _row(reference_gain * form.sensor, form, gain, scale)
    displacement, displacement_direct = _row(reference_gain * form.displacement, form, gain, scale)
    held = HeldPlant(ad, bd, late, sensor, displacement, sensor_direct, displacement_direct)
    return held if order_held == order else _raised(held, a, b, order, scale)


def _row(num: FloatArray, form: _Canonical, gain: float, scale: float) -> tuple[FloatArray, float]:
    size = form.den.size - 1
    if num.size <= size:
        return np.append(num, np.zeros(size - num.size)) * scale ** np.arange(size), 0.0
    direct = num[size]
    return (num[:size] - direct * form.den[:size]) * scale ** np.arange(size), float(direct * gain)


def _raised(held: HeldPlant, a: FloatArray, b: FloatArray, order: int, scale: float) -> HeldPlant:
    """Return the same plant with the higher derivatives of xi as further states, for a load that needs them.

    They follow from the lower ones at the end of each sample, so that nothing jumps when the load is put on.
    """
    order_held = held.b.size
    raised_a, raised_b, raised_late = np.zeros((order, order)), np.zeros(order), np.zeros(order)
    raised_a[:order_held, :order_held], raised_b[:order_held], raised_late[:order_held] = held.a, held.b, held.late
    row, held_input = a[-1] / scale, b[-1] / scale  # xi^(order_held) = row x + held_input u
    for i in range(order_held, order):
        raised_a[i, :order_held], raised_b[i], raised_late[i] = row @ held.a, row @ held.b + held_input, row @ held.late
        held_input, row = float(row @ b) / scale, row @ a / scale
    pad = np.zeros(order - order_held)
    return replace(
        held,
        a=raised_a,
        b=raised_b,
        late=raised_late,
        sensor=np.append(held.sensor, pad),
        displacement=np.append(held.displacement, pad),
    )


def converter_table(converter: Converter) -> Any:
    """Return the `tact_converter` of a channel."""
    table = ffi.new("tact_converter *")
    lib.tact_converter_make(
        table, converter.bits, converter.range_v, float(converter.polarity), float(converter.offset_v)
    )
    return table


@lru_cache(maxsize=16)
def controller_table(channel: ChannelController, rate_hz: float, place: int) -> tuple[Any, Any]:
    """Return `tact_controller` and `tact_strength` of a channel, as the core reads them in an image; kept for the next
    simulation.

    The simulated display so runs the very numbers that a board runs; unlike a board it also takes unstable sections, to
    show what they do, and any limit. Raises BadInput for what the core cannot run.
    """
    body = channel_bytes(channel, rate_hz, place)
    content = ffi.from_buffer("uint8_t[]", body)
    reader = ffi.new("tact_reader *", {"bytes": content, "size": len(body)})
    controller, strength = ffi.new("tact_controller *"), ffi.new("tact_strength *")
    name = ffi.new("uint8_t[]", lib.TACT_NAME_SIZE)
    refusal = ImageRefusal(lib.tact_image_read_channel(reader, name, controller, strength))
    if refusal is not ImageRefusal.GOOD:
        raise refusal.error("controller", f"channel {channel.name!r}")
    return controller, strength


def load_names(channel: Channel) -> tuple[str | None, ...]:
    """Return the loads of a channel in the order of the core's numbers; None first: nothing touches."""
    return (None, *(load.name for load in channel.loads))


@lru_cache(maxsize=16)
def display_table(channel: Channel, rate_hz: float) -> tuple[Any, Any]:
    """Return the `tact_display` of a channel, and the plants that it points to; kept for a next one of that channel."""
    held = held_plants(channel, rate_hz)
    plants = ffi.new("tact_plant[]", len(held.plants))
    for table, plant in zip(plants, held.plants, strict=True):
        table.order = order = plant.b.size
        for i in range(order):
            table.a[i][0:order] = plant.a[i].tolist()
        for name in ("b", "late", "sensor", "displacement"):
            getattr(table, name)[0:order] = getattr(plant, name).tolist()
        table.sensor_direct, table.displacement_direct = plant.sensor_direct, plant.displacement_direct
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
    lines = [(f, a) for f, a in zip(environment.hum_hz, environment.hum_v_peak, strict=True) if a > 0.0]
    if len(lines) > lib.TACT_HUM_MAX:
        raise BadInput(f"channel {channel.name!r}: {len(lines)} lines of hum", f"at most {lib.TACT_HUM_MAX}")
    hum = display.hum
    hum.count = len(lines)
    for i, (frequency_hz, amplitude_v) in enumerate(lines):
        angle = 2.0 * np.pi * frequency_hz / rate_hz
        hum.cosine[i], hum.sine[i], hum.amplitude_v[i] = np.cos(angle), np.sin(angle), amplitude_v
    return display, plants


def simulated_board_bytes(display: Display, seed: int) -> bytes:
    """Return the display, for `seed`, as a simulated board takes it. Raises BadInput where it has no room for it."""
    parts = []
    for channel in display.channels:
        table, _plants = display_table(channel, display.rate_hz)
        if len(channel.loads) >= lib.TACT_SIMULATED_BOARD_PLANTS_MAX:
            raise BadInput(
                f"channel {channel.name!r}: {len(channel.loads)} loads",
                f"at most {lib.TACT_SIMULATED_BOARD_PLANTS_MAX - 1} on a simulated board",
            )
        converter = channel.converter
        parts.append(struct.pack("<iidd", converter.bits, converter.polarity, converter.range_v, converter.offset_v))
        parts.append(_device_bytes(table))
    body = struct.pack("<I", seed) + b"".join(parts)
    head = struct.pack("<4sHHI", b"TACW", 1, len(display.channels), 12 + len(body) + 4)
    content = sealed(head + body)
    if len(content) > lib.TACT_SIMULATED_BOARD_MAX:
        raise BadInput(
            f"the display takes {len(content)} bytes", f"{lib.TACT_SIMULATED_BOARD_MAX} on a simulated board"
        )
    return content


def _device_bytes(table: Any) -> bytes:
    friction, hum = table.friction, table.hum
    lines = [(hum.cosine[i], hum.sine[i], hum.amplitude_v[i]) for i in range(hum.count)]
    content = struct.pack("<ii", table.dead_time, table.has_late)
    content += struct.pack("<4d", friction.stiffness, friction.per_presliding, table.sensor_v_per_mm, table.noise_v)
    content += struct.pack("<i", hum.count) + b"".join(struct.pack("<3d", *line) for line in lines)
    order = table.plants[0].order
    content += struct.pack("<ii", table.plant_count, order)
    for plant in table.plants[0 : table.plant_count]:
        numbers = [plant.a[i][j] for i in range(order) for j in range(order)]
        for row in (plant.b, plant.late, plant.sensor, plant.displacement):
            numbers += list(row[0:order])
        content += struct.pack(f"<{len(numbers) + 2}d", *numbers, plant.sensor_direct, plant.displacement_direct)
    return content

"""A channel's plant under each of its loads, held by converters: matrices that share one set of states.

Controller canonical form, y = num(xi) with den(xi) = u: a load changes den alone, so the states xi, xi', xi'', ... go
on when a load is put on or taken off, and with them position and velocity. They are scaled by powers of a typical
pole, which keeps the matrix exponential accurate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.description import Channel
from tactuator.model.load import DERIVATIVES
from tactuator.signals.discretise import matrix_exponential
from tactuator.signals.systems import ContinuousSystem

ORDER_MAX = 8


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
    load_names: tuple[str | None, ...]
    dead_time: int
    has_late: bool


@dataclass(frozen=True)
class _Canonical:
    """A plant in canonical form: den(xi) = gain u, monic; y = sensor(xi) volts and displacement(xi) mm; ascending
    powers of s.
    """

    den: FloatArray
    gain: float
    sensor: FloatArray
    displacement: FloatArray


@lru_cache(maxsize=16)
def held_plants(channel: Channel, rate_hz: float) -> HeldPlants:
    """Return the tables for the simulated display, kept for a next one of the same channel; not to be written to.

    Raises BadInput for an improper plant or one of too high an order.
    """
    plants = [channel.plant, *(channel.loaded_plant(load) for load in channel.loads)]
    forms = [_canonical(channel, plant) for plant in plants]
    order = max(form.den.size - 1 for form in forms)
    if not 1 <= order <= ORDER_MAX:
        raise BadInput(f"channel {channel.name!r}: its plant is of order {order} here", f"1 to {ORDER_MAX}")
    _check_shared_numerator(channel, forms)
    samples = channel.plant.delay_s * rate_hz
    whole = math.floor(samples + 1e-9)
    fraction = samples - whole if samples - whole > 1e-9 else 0.0
    scale = _typical_pole(forms)
    held = tuple(_hold(form, order, forms[0].gain, scale, rate_hz, fraction) for form in forms)
    return HeldPlants(held, (None, *(load.name for load in channel.loads)), whole, fraction > 0.0)


def _canonical(channel: Channel, plant: ContinuousSystem) -> _Canonical:
    if not plant.is_proper:
        raise BadInput(
            f"channel {channel.name!r}: plant has {plant.zeros.size} zeros and {plant.poles.size} poles",
            "no more zeros than poles",
        )
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
    """Return the plant, held, in the states xi^(i) / scale^i, where xi is that of the plant without load times its
    gain.
    """
    own = form.den.size - 1
    gain = form.gain / reference_gain
    a = np.eye(own, k=1) * scale
    a[-1] -= form.den[:-1] * scale ** (np.arange(own) - own + 1.0)
    b = np.zeros(own)
    b[-1] = gain * scale ** (1.0 - own)
    ad, bd = _exponential(a, b, 1.0 / rate_hz)
    late = np.zeros(own)
    if fraction > 0.0:
        after, _ = _exponential(a, b, (1.0 - fraction) / rate_hz)
        late = after @ _exponential(a, b, fraction / rate_hz)[1]
    sensor, sensor_direct = _row(reference_gain * form.sensor, form, gain, scale)
    displacement, displacement_direct = _row(reference_gain * form.displacement, form, gain, scale)
    held = HeldPlant(ad, bd, late, sensor, displacement, sensor_direct, displacement_direct)
    return held if own == order else _raised(held, a, b, order, scale)


def _row(num: FloatArray, form: _Canonical, gain: float, scale: float) -> tuple[FloatArray, float]:
    own = form.den.size - 1
    if num.size <= own:
        return np.append(num, np.zeros(own - num.size)) * scale ** np.arange(own), 0.0
    direct = num[own]
    return (num[:own] - direct * form.den[:own]) * scale ** np.arange(own), float(direct * gain)


def _exponential(a: FloatArray, b: FloatArray, duration_s: float) -> tuple[FloatArray, FloatArray]:
    """Return exp(a t) and its integral over [0, t] times b."""
    own = b.size
    block = np.zeros((own + 1, own + 1))
    block[:own, :own], block[:own, own] = a * duration_s, b * duration_s
    # scaled so that the input's column weighs as much as the rest: the exponential's error is relative to the norm
    weight = np.linalg.norm(b * duration_s) or 1.0
    block[:own, own] /= weight
    exponential = matrix_exponential(block)
    return exponential[:own, :own], exponential[:own, own] * weight


def _raised(held: HeldPlant, a: FloatArray, b: FloatArray, order: int, scale: float) -> HeldPlant:
    """Return the same plant with the higher derivatives of xi as further states, for a load that needs them.

    They follow from the lower ones at the end of each sample, so that nothing jumps when the load is put on.
    """
    own = held.b.size
    raised_a, raised_b, raised_late = np.zeros((order, order)), np.zeros(order), np.zeros(order)
    raised_a[:own, :own], raised_b[:own], raised_late[:own] = held.a, held.b, held.late
    row, held_input = a[-1] / scale, b[-1] / scale  # xi^(own) = row x + held_input u
    for i in range(own, order):
        raised_a[i, :own], raised_b[i], raised_late[i] = row @ held.a, row @ held.b + held_input, row @ held.late
        held_input, row = float(row @ b) / scale, row @ a / scale
    pad = np.zeros(order - own)
    return HeldPlant(
        raised_a,
        raised_b,
        raised_late,
        np.append(held.sensor, pad),
        np.append(held.displacement, pad),
        held.sensor_direct,
        held.displacement_direct,
    )

"""Round-off and limit cycles: one channel's loop stepped in the arithmetic of a number format.

The plant is the sampled one in double precision, without noise, friction or converters: what is left over is the
arithmetic's alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.digital._core import ffi, lib
from tactuator.digital.controller import ChannelController, Controller
from tactuator.digital.discretise import held_state_space
from tactuator.digital.image import build_image
from tactuator.errors import BadInput
from tactuator.plant.display import Channel

Samples = NDArray[np.float64]
Step = Callable[[float, float], float]
SECTIONS_HASH = "0" * 64


def core_step(controller: Controller, index: int, number_format: str) -> Step:
    """reference, position -> command of one channel, as the core computes it from the image in `number_format`."""
    image, parsed = build_image(controller, number_format, SECTIONS_HASH), ffi.new("tact_image *")
    refusal = lib.tact_image_parse(
        parsed, ffi.from_buffer(image), len(image), controller.rate_hz, controller.delay_samples,
        len(controller.channels),
    )  # fmt: skip
    if refusal:
        raise BadInput(f"the core refuses the image ({refusal}); allowed: one that `build` makes")
    if number_format == "float32":
        table: Any = ffi.addressof(parsed.tables.single, index)
        state = ffi.new("tact_controller_state *")
        lib.tact_controller_reset(state)
        return lambda r, y, _keep=parsed: float(lib.tact_controller_step(table, state, r, y))  # type: ignore[misc]
    table = ffi.addressof(parsed.tables.q31, index)
    state = ffi.new("tact_controller_q31_state *")
    lib.tact_controller_q31_reset(state)
    return lambda r, y, _keep=parsed: float(lib.tact_controller_q31_step(table, state, r, y))  # type: ignore[misc]


def double_step(controller: ChannelController) -> Step:
    """The same in double precision: what the formats are compared with."""
    prefilter = _Double(controller.prefilter_sos)
    feedback = None if controller.feedback_sos is None else _Double(controller.feedback_sos)
    most = controller.limits.command_v

    def step(reference: float, position: float) -> float:
        wanted = prefilter(reference)
        if feedback is not None:
            wanted = feedback(wanted - position)
        return max(-most, min(most, wanted))

    return step


class _Double:
    """A cascade in delta form, double precision."""

    def __init__(self, sos: Samples) -> None:
        a = sos[:, 3:] / sos[:, 3:4]
        b = sos[:, :3] / sos[:, 3:4]
        self._rows = [
            (x[0], 2 * x[0] + x[1], x[0] + x[1] + x[2], 2 + y[1], 1 + y[1] + y[2]) for x, y in zip(b, a, strict=True)
        ]
        self._states = [[0.0, 0.0] for _ in self._rows]

    def __call__(self, value: float) -> float:
        for (b0, b1, b2, a1, a2), state in zip(self._rows, self._states, strict=True):
            out = b0 * value + state[0]
            state[0] += b1 * value - a1 * out + state[1]
            state[1] += b2 * value - a2 * out
            value = out
        return float(value)


def run_loop(channel: Channel, rate_hz: float, delay_samples: int, step: Step, reference: Samples) -> Samples:
    """y (n,), volts, of the sampled plant with `step` around it."""
    a, b, c, d = held_state_space(channel.plant, 1.0 / rate_hz, 0.0)
    state, queue = np.zeros(b.size), [0.0] * (delay_samples + round(channel.plant.delay_s * rate_hz))
    position = np.empty(reference.size)
    for k, value in enumerate(reference):
        held = queue[0] if queue else 0.0
        position[k] = c @ state + d * held
        queue.append(step(float(value), float(position[k])))
        state = a @ state + b * queue.pop(0)
    return position


def felt_db_sl(error_v: Samples, channel: Channel, rate_hz: float) -> float:
    """Level of a stretch of y's error as it is felt, dB SL: its spectrum over the band, each line over its threshold;
    the sinusoid of the same rms. -300 where nothing is left."""
    spectrum = np.fft.rfft((error_v - np.mean(error_v)) * np.hanning(error_v.size)) / error_v.size
    frequency = np.fft.rfftfreq(error_v.size, 1.0 / rate_hz)
    low, high = channel.threshold.band_hz
    inside = (frequency >= low) & (frequency <= high)
    felt = np.abs(spectrum[inside]) / channel.threshold_voltage(frequency[inside])
    power = 2.0 * float(np.sum(felt**2)) / 0.375  # the window's mean square
    return float(10.0 * np.log10(max(2.0 * power, 1e-30)))

"""The simulated display with its controller, run by the core in blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.tables import (
    controller_table,
    display_table,
    load_names,
)

REFERENCE_MAX = 1000.0
"""Threshold units: 60 dB SL, the full scale of a reference in a WAV."""
_ROUNDED_MAX = REFERENCE_MAX * (1.0 + 2.0**-25)  # what single precision takes for the largest
_SINGLE_MAX = float(np.finfo(np.float32).max)
_TRACE, _DOUBLES, _FLAGS = (ffi.typeof(name) for name in ("tact_trace *", "double[]", "uint8_t[]"))


@dataclass(frozen=True)
class Block:
    """Signals of a block of n samples, all of shape (n, channels).

    command_v: at the motor, beginning at each instant. position_v: as the A/D read it at each instant.
    displacement_mm: the truth at the finger. saturated: a converter or a limit was reached.
    """

    command_v: FloatArray
    position_v: FloatArray
    displacement_mm: FloatArray
    saturated: NDArray[np.bool_]


@dataclass(frozen=True)
class SimulatedBlock(Block):
    """Signals of a block of the simulation. broken: the controller's arithmetic had overflowed, and it gave zero."""

    broken: NDArray[np.bool_]


class Simulation:
    """Every channel of `display`: plant, loads, friction, sensor, hum, noise, converters, and a controller if loaded.

    The same seed gives the same numbers, whatever the sizes of the blocks; channels have independent noise. Raises
    BadInput for what cannot be simulated: order above 8, a direct part without computing delay.
    """

    def __init__(self, display: Display, seed: int = 0) -> None:
        if not 0 <= seed < 2**32:
            raise BadInput(f"seed is {seed}", f"0 to {2**32 - 1}")
        self.display = display
        self._keep: list[Any] = []
        self._loops = ffi.new("tact_closed_loop[]", len(display.channels))
        for index, (loop, channel) in enumerate(zip(self._loops, display.channels, strict=True)):
            table, plants = display_table(channel, display.rate_hz)
            if display.delay_samples == 0 and any(plant.sensor_direct for plant in plants):
                raise BadInput(
                    f"channel {channel.name!r}: the plant answers at once and delay_samples is 0", "1 or more"
                )
            self._keep += [table, plants]
            loop.display, loop.delay_samples = table, display.delay_samples
            lib.tact_display_reset(table, ffi.addressof(loop, "display_state"), seed, index)
            lib.tact_closed_loop_rest(ffi.addressof(self._loops, index))
        self._controllers: list[Any] = []

    def load(self, controller: Controller) -> None:
        """Load the controller of every channel; its states start at zero, the device goes on as it is."""
        controller.require_runs(self.display)
        tables = [controller_table(each, controller.rate_hz, place) for place, each in enumerate(controller.channels)]
        for loop, (table, strength) in zip(self._loops, tables, strict=True):
            loop.controller, loop.strength = table, strength
        self._controllers = tables
        self.rest()

    def rest(self) -> None:
        """Set the controller and the computing delay to zero; no time passes for the device."""
        for index in range(len(self._loops)):
            lib.tact_closed_loop_rest(ffi.addressof(self._loops, index))

    def weights(self) -> FloatArray:
        """Return the weights that each channel has learnt of its finger, (channels, 2); zeros where none are learnt."""
        return np.array([list(loop.controller_state.touch.weight) for loop in self._loops], dtype=np.float64)

    def touch(self, channel: int, load: str | None) -> None:
        """Put a load that is described on a channel (None: take it off). Position and velocity go on."""
        self._loops[channel].display_state.touched = load_names(self.display.channels[channel]).index(load)

    def play(self, reference: ArrayLike, force_v: ArrayLike | None = None) -> SimulatedBlock:
        """Play a reference (n, channels) in threshold units through the controller; force_v (n, channels) acts at the
        fingers, in volts of command.
        """
        if not self._controllers:
            raise BadInput("no controller is loaded: load one before playing a reference")
        return self._run(lib.tact_closed_loop_play, reference, "reference", force_v)

    def drive(self, command_v: ArrayLike, force_v: ArrayLike | None = None) -> SimulatedBlock:
        """Drive the converters with a command (n, channels) in volts, without controller and computing delay."""
        return self._run(lib.tact_closed_loop_drive, command_v, "command", force_v)

    def _run(self, step: Any, samples: ArrayLike, name: str, force_v: ArrayLike | None) -> SimulatedBlock:
        check_arithmetic()
        count = len(self._loops)
        inputs = block_samples(samples, count, name)
        forces = ffi.NULL
        if force_v is not None:
            force = block_samples(force_v, count, "force")
            if force.shape != inputs.shape:
                raise BadInput(f"force has {force.shape[0]} samples", f"{inputs.shape[0]}, as the {name} has")
            forces = ffi.from_buffer("double[]", force)
        block, trace = empty_block(inputs.shape[0], count)
        step(self._loops, count, ffi.from_buffer("double[]", inputs), forces, trace, inputs.shape[0])
        return block


def empty_block(samples: int, columns: int) -> tuple[SimulatedBlock, Any]:
    """Return a block to be filled, and the `tact_trace` that points into it.

    Two pieces of memory for all of it: the next block takes what one gives back, and the system, which hands out every
    page anew, is not asked.
    """
    size = samples * columns
    volts, flags = np.empty((3, samples, columns)), np.empty((2, samples, columns), dtype=np.bool_)
    command, position, displacement = volts
    saturated, broken = flags
    at, mark = ffi.from_buffer(_DOUBLES, volts), ffi.from_buffer(_FLAGS, flags)
    trace = ffi.new(_TRACE, (at, at + size, at + 2 * size, mark, mark + size))
    return SimulatedBlock(command, position, displacement, saturated, broken), trace


def check_arithmetic() -> None:
    """Raise RuntimeError where a foreign library has made this thread flush subnormal numbers to zero."""
    if not lib.tact_finite_is_ieee():
        raise RuntimeError(
            "a library of this process has switched the processor to flush subnormal numbers to zero (-ffast-math does "
            "that): the core's bits would not be those of other machines"
        )


def block_samples(samples: ArrayLike, channels: int, name: str) -> FloatArray:
    """Return `samples` as a contiguous array (n, channels); one channel takes a vector. Raises BadInput if not."""
    try:
        array = np.asarray(samples)
    except ValueError:
        raise BadInput(f"{name} has rows of unequal length", f"(samples, {channels})") from None
    if array.ndim == 0:
        raise BadInput(f"{name} is {samples!r:.60}", f"real numbers, (samples, {channels})")
    if array.ndim == 1 and channels == 1:
        array = array[:, None]
    if array.ndim != 2 or array.shape[1] != channels:
        raise BadInput(f"{name} has shape {array.shape}", f"(samples, {channels})")
    if array.dtype.kind not in "fiub":
        raise BadInput(f"{name} holds {array.dtype}", "real numbers")
    whole = np.ascontiguousarray(array, dtype=np.float64)
    return whole if whole.flags.aligned else whole.copy()


def take_reference(reference: FloatArray) -> FloatArray:
    """Return a checked copy of a reference of any shape, contiguous, threshold units.

    Raises BadInput for what is not finite or beyond 60 dB SL.
    """
    copy = _taken(reference, _ROUNDED_MAX)
    if copy is None:
        raise BadInput(
            "the reference is not finite or beyond 60 dB SL", f"finite, at most {REFERENCE_MAX:g} threshold units"
        )
    return copy


def take_command(command_v: FloatArray) -> FloatArray:
    """Return a checked copy of a command of any shape, contiguous, volts. Raises BadInput for what is not finite."""
    copy = _taken(command_v, _SINGLE_MAX)
    if copy is None:
        raise BadInput("the command is not finite", "volts")
    return copy


def _taken(samples: FloatArray, most: float) -> FloatArray | None:
    copy = np.array(samples, order="C")
    is_within = copy.min(initial=0.0) >= -most and copy.max(initial=0.0) <= most  # NaN is not
    return copy if is_within else None

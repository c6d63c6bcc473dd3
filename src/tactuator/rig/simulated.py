"""Computed rigs, whose time stops between blocks: the simulated display, and your own; and a rig that takes as long as
the stimuli last, since the simulated display computes faster than real time.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.parameters import checked
from tactuator.rig.rig import Finger, Rig, Trace, let_feel, take_forces
from tactuator.runtime.simulation import Block, Simulation
from tactuator.runtime.tables import load_names


class Device(Protocol):
    """A display with its controller, as a program computes them: what a `ComputedRig` runs.

    Arrays have a row for each sample and a column for each channel; what they hold has been checked. force_v: of the
    fingers, volts of command that would push as hard; None where nothing presses.
    """

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs, its states at rest; it has been found to be for the display."""

    def play(self, reference: FloatArray, force_v: FloatArray | None) -> Block:
        """Play a reference in threshold units through the controller. State carries on."""
        ...

    def drive(self, command_v: FloatArray, force_v: FloatArray | None) -> Block:
        """Drive the motors with a command in volts: no controller, no computing delay. State carries on."""
        ...

    def rest(self) -> None:
        """Set output and controller states to zero; no time passes."""

    def touch(self, channel: int, load: str | None) -> None:
        """Put a load of that channel on, None: take it off. Position and velocity go on."""


class ComputedRig(Rig):
    """The rig of a `device` that computes `display`: it checks what comes, keeps time, presses and lets feel."""

    def __init__(self, display: Display, device: Device) -> None:
        super().__init__(display)
        self._device = device
        self._ticks, self.waits = 0, True
        self._fingers = tuple(
            Finger(load_names(channel), partial(device.touch, index)) for index, channel in enumerate(display.channels)
        )

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs, from rest. Raises BadInput if it is not for this rig."""
        self.require_runs(controller)
        self._device.load(controller)
        self._loaded = True

    def play(self, reference: ArrayLike) -> Trace:
        """Play a reference (n, channels), threshold units, through the loaded controller; state carries on.

        Raises BadInput, the output at rest, for a reference that is not finite or beyond 60 dB SL.
        """
        self._require_controller()
        rows = self._reference(reference)
        forces_v = self._begin(len(rows))
        return self._trace(self._device.play(rows, forces_v), rows)

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Play blocks as `Rig.stream` does: each block is asked for when the one before has been played."""
        self._require_controller()
        began_at = self._ticks
        for block in blocks:
            trace = self.play(block)
            self.began_at, self.rows_played = began_at, self._ticks - began_at
            yield trace

    def drive(self, command_v: ArrayLike) -> Trace:
        """Drive the motors with a command (n, channels), volts: no controller, no computing delay.

        Raises BadInput, the output at rest, for a command that is not finite.
        """
        rows = self._command(command_v)
        forces_v = self._begin(len(rows))
        return self._trace(self._device.drive(rows, forces_v), np.zeros(rows.shape))

    def rest(self, settle_s: float = 1.0) -> None:
        """Set output and controller states to zero, and let `settle_s` seconds pass for the display to come to rest."""
        self._device.rest()
        if settle_s > 0.0:
            self.drive(np.zeros((round(settle_s * self.rate_hz), len(self._fingers))))

    def _begin(self, count: int) -> FloatArray | None:
        self.began_at, self.rows_played, self._ticks = self._ticks, count, self._ticks + count
        return take_forces(self._fingers, count)

    def _trace(self, block: Block, reference: FloatArray) -> Trace:
        let_feel(self._fingers, block.displacement_mm)
        limited = block.saturated | (np.abs(block.position_v) > self.travel_v)
        return Trace(self.rate_hz, self.channels, reference, block.command_v, block.position_v, limited)


class SimulatedRig(ComputedRig):
    """The simulated `display` as a rig, blind but for its sensor. The same seed gives the same numbers.

    >>> tt.SimulatedRig(controller.display, seed=1)
    <SimulatedRig three-finger tactuator: index, thumb, middle at 4000 Hz, no controller yet>
    """

    reshapes = feeds_forward = True

    @checked
    def __init__(self, display: Display, seed: int = 0) -> None:
        self._simulation = Simulation(display, seed)
        super().__init__(display, self._simulation)

    def weights(self) -> FloatArray:
        """Return the weights that each channel has learnt of its finger, (channels, 2); zeros where none are learnt."""
        return self._simulation.weights()


_PIECE_S = 0.002
"""Time for which a computed stream cannot be taken back: what is computed is felt."""
_LATE_S = 0.03
"""A stream that is computed later than this, by which a sound card is fed ahead, does not catch up: its time has stood
still."""
_FADE_S, _FADE_POWER, _QUIET_S = 0.017, 2.5, 0.06
"""A stream that is ended fades by a power of what is left of the first, and the loop stays closed for the last:
releasing a moving motor can be felt. Tones of 100 Hz are silent in 10 ms at any phase; after a cosine, in 20.
"""


class PacedRig(Rig):
    """The given `rig`, slowed down: each block takes its own duration over `speed` (1: real time)."""

    def __init__(self, rig: Rig, speed: float = 1.0) -> None:
        super().__init__(rig.display)
        self._rig = rig
        self.speed: float = speed
        self._fingers, self.without_sensor = rig._fingers, rig.without_sensor
        self._coming: Iterator[FloatArray] = iter(())  # what a computed stream that goes on has not played yet

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs."""
        self._rig.load(controller)

    def play(self, reference: ArrayLike) -> Trace:
        """Play, and wait until the block would be over."""
        return self._wait(self._rig.play(reference), time.monotonic(), np.shape(reference)[0])

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Stream, and wait with each piece of the trace until it would have been played."""
        began_s, self.rows_played = time.monotonic(), 0
        if isinstance(self._rig, ComputedRig):
            blocks = self._coming = self._pieces(blocks)
        for trace in self._rig.stream(blocks):
            count = self.rows_played + len(trace)
            self._wait(trace, began_s, count)
            late_s = time.monotonic() - began_s - count / self.rate_hz / self.speed
            if late_s > (_LATE_S if self.rows_played else 0.0):
                began_s += late_s
            self.rows_played = count
            yield trace

    def _pieces(self, blocks: Iterable[ArrayLike]) -> Iterator[FloatArray]:
        step = max(1, round(_PIECE_S * self.speed * self.rate_hz))
        for block in blocks:
            rows = np.asarray(block, dtype=np.float64)
            yield from (rows[start : start + step] for start in range(0, len(rows), step))

    def rest(self) -> None:
        """Bring the output to rest; a computed stream that goes on is faded out first."""
        fall, coming, count = np.linspace(1.0, 0.0, round(_FADE_S * self.rate_hz)) ** _FADE_POWER, [], 0
        while count < fall.size and (piece := next(self._coming, None)) is not None:
            coming.append(piece)
            count += len(piece)
        self._coming = iter(())
        if coming:
            rows = np.concatenate([*coming, np.zeros((fall.size, len(self.channels)))])[: fall.size]
            self.play(np.concatenate([fall[:, None] * rows, np.zeros((round(_QUIET_S * self.rate_hz), rows.shape[1]))]))
        self._rig.rest()

    def drive(self, command_v: ArrayLike) -> Trace:
        """Drive, and wait until the block would be over."""
        return self._wait(self._rig.drive(command_v), time.monotonic(), np.shape(command_v)[0])

    def close(self) -> None:
        """Close the rig that is paced."""
        self._rig.close()

    def _wait(self, trace: Trace, began_s: float, count: int) -> Trace:
        left_s = count / self.rate_hz / self.speed - (time.monotonic() - began_s)
        if left_s > 0.0:
            time.sleep(left_s)
        self.began_at = self._rig.began_at
        return trace

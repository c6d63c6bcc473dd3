"""The simulated display as a rig: blind but for its sensor, and open to touch at its finger ports."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.rig.finger import Finger, let_feel, take_forces
from tactuator.rig.rig import DisplayRig, Trace
from tactuator.runtime.simulation import SimulatedBlock, Simulation, block_samples, take_command, take_reference


class FingerPort(Finger):
    """The port at which a finger meets one channel: the only way to what it feels, and the only way to act on it."""

    def __init__(self, simulation: Simulation, index: int) -> None:
        super().__init__()
        self._simulation = simulation
        self._index = index

    def touch(self, load: str | None) -> None:
        """Put a load of the display file on, by name; None takes it off. Position and velocity go on."""
        self._simulation.touch(self._index, load)


class SimulatedRig(DisplayRig):
    """The simulated `display` as a rig. The same seed gives the same numbers."""

    def __init__(self, display: Display, seed: int = 0) -> None:
        super().__init__(display)
        self._simulation = Simulation(display, seed)
        self._began_at: int | None = None
        self._ticks = 0
        self._ports = tuple(FingerPort(self._simulation, index) for index in range(len(display.channels)))

    @property
    def began_at(self) -> int | None:
        """Return the sample, of all that were played or driven, at which the last block or stream began."""
        return self._began_at

    @property
    def rows_played(self) -> int:
        """Return the number of samples played since the last block or stream began."""
        return 0 if self._began_at is None else self._ticks - self._began_at

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs, from rest. Raises BadInput if it is not for this rig."""
        self._simulation.load(controller)

    def play(self, reference: ArrayLike) -> Trace:
        """Play a reference (n, channels), threshold units, through the loaded controller; state carries on.

        Raises BadInput, the output at rest, for a reference that is not finite or beyond 60 dB SL.
        """
        own = self._taken(take_reference, reference, "reference")
        self._began_at, self._ticks = self._ticks, self._ticks + len(own)
        return self._trace(self._simulation.play(own, take_forces(self._ports, len(own))), own)

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Play blocks as `Rig.stream` does: each block is asked for when the one before has been played."""
        began_at = self._ticks
        for block in blocks:
            trace = self.play(block)
            self._began_at = began_at
            yield trace

    def drive(self, command_v: ArrayLike) -> Trace:
        """Drive the motors with a command (n, channels), volts: no controller, no computing delay.

        Raises BadInput, the output at rest, for a command that is not finite.
        """
        rows = self._taken(take_command, command_v, "command")
        self._began_at, self._ticks = self._ticks, self._ticks + len(rows)
        block = self._simulation.drive(rows, take_forces(self._ports, len(rows)))
        return self._trace(block, np.zeros(block.command_v.shape))

    def rest(self, settle_s: float = 1.0) -> None:
        """Set output and controller states to zero, and let `settle_s` seconds pass for the display to come to rest."""
        self._simulation.rest()
        if settle_s > 0.0:
            self.drive(np.zeros((round(settle_s * self.rate_hz), len(self._ports))))

    @property
    def waits(self) -> bool:
        """Return True: time stands still between blocks."""
        return True

    def weights(self) -> FloatArray:
        """Return the weights that each channel has learnt of its finger, (channels, 2); zeros where none are learnt."""
        return self._simulation.weights()

    @property
    def has_finger_ports(self) -> bool:
        """Return True, since the display is simulated."""
        return True

    def finger(self, channel: str) -> FingerPort:
        """Return the finger port of a channel. Raises BadInput if there is none of that name."""
        if channel not in self.channels:
            raise BadInput(f"channel {channel!r} is not there", f"{', '.join(self.channels)}")
        return self._ports[self.channels.index(channel)]

    def _taken(self, take: Callable[[FloatArray], FloatArray], samples: ArrayLike, name: str) -> FloatArray:
        rows = block_samples(samples, len(self._ports), name)
        try:
            return take(rows)
        except BadInput:
            self.rest()
            raise

    def _trace(self, block: SimulatedBlock, reference: FloatArray) -> Trace:
        let_feel(self._ports, block.displacement_mm)
        return Trace(self.rate_hz, self.channels, reference, block.command_v, block.position_v, block.saturated)

"""The simulated display as a rig: blind but for its sensor, and open to touch at its finger ports."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.digital.controller import Controller
from tactuator.digital.simulation import SimulatedBlock, Simulation, block_samples
from tactuator.errors import BadInput
from tactuator.plant.display import Display
from tactuator.rig.trace import Trace

Feeler = Callable[[NDArray[np.float64]], None]


class FingerPort:
    """Where a finger meets one channel: the only way to what it feels, and the only way to act on it."""

    def __init__(self, simulation: Simulation, index: int) -> None:
        self._simulation = simulation
        self._index = index
        self._feelers: list[Feeler] = []
        self._pressed_v: NDArray[np.float64] = np.zeros(0)

    def touch(self, load: str | None) -> None:
        """Put a load of the display file on, by name; None takes it off. Position and velocity go on."""
        self._simulation.touch(self._index, load)

    def press(self, force_v: ArrayLike) -> None:
        """A force for the coming samples, shape (n,), in volts of command that would push as hard; then none again.

        It is added to what is still to come of earlier presses.
        """
        force = np.atleast_1d(np.asarray(force_v, dtype=np.float64))
        if force.ndim != 1 or not np.all(np.isfinite(force)):
            raise BadInput(f"force has shape {force.shape}; allowed: (n,), finite volts of command")
        pressed = np.zeros(max(force.size, self._pressed_v.size))
        pressed[: self._pressed_v.size] = self._pressed_v
        pressed[: force.size] += force
        self._pressed_v = pressed

    def attach(self, feeler: Feeler) -> None:
        """Call `feeler(displacement_mm)`, shape (n,), after every block: an observer, a dial gauge."""
        self._feelers.append(feeler)

    def detach(self, feeler: Feeler) -> None:
        """Take a feeler off again. Raises BadInput if it is not attached."""
        if feeler not in self._feelers:
            raise BadInput("that feeler is not attached to this finger port; allowed: one that is")
        self._feelers.remove(feeler)

    def _take_force(self, count: int) -> NDArray[np.float64] | None:
        if self._pressed_v.size == 0:
            return None
        force = np.zeros(count)
        now = self._pressed_v[:count]
        force[: now.size] = now
        self._pressed_v = self._pressed_v[count:]
        return force

    def _feel(self, displacement_mm: NDArray[np.float64]) -> None:
        for feeler in self._feelers:
            feeler(displacement_mm.copy())


class SimulatedRig:
    """`display` simulated: see design.md, "The simulated display". The same seed gives the same numbers."""

    def __init__(self, display: Display, seed: int = 0) -> None:
        self._simulation = Simulation(display, seed)
        self._names = tuple(channel.name for channel in display.channels)
        self._ports = tuple(FingerPort(self._simulation, index) for index in range(len(display.channels)))

    @property
    def display(self) -> Display:
        """The display that is simulated."""
        return self._simulation.display

    @property
    def rate_hz(self) -> float:
        """Sampling rate, hertz."""
        return self.display.rate_hz

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, in the order of every array's columns."""
        return self._names

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs, from rest. Raises BadInput if it is not for this rig."""
        self._simulation.load(controller)

    def play(self, reference: ArrayLike) -> Trace:
        """Reference (n, channels), threshold units, through the loaded controller; state carries on."""
        samples = block_samples(np.array(reference), len(self._ports), "reference", np.float64)  # the trace's own
        return self._trace(self._simulation.play(samples, self._forces(samples.shape[0])), samples)

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """See Rig.stream: each block is asked for when the one before has been played."""
        return (self.play(block) for block in blocks)

    def drive(self, command_v: ArrayLike) -> Trace:
        """Command (n, channels), volts, straight to the motors: no controller, no computing delay."""
        samples = block_samples(command_v, len(self._ports), "command", np.float64)
        block = self._simulation.drive(samples, self._forces(samples.shape[0]))
        return self._trace(block, np.zeros(block.command_v.shape))

    def rest(self, settle_s: float = 1.0) -> None:
        """Output to zero, controller states to zero, and `settle_s` seconds for the display to come to rest in."""
        self._simulation.rest()
        if settle_s > 0.0:
            self.drive(np.zeros((round(settle_s * self.rate_hz), len(self._ports))))

    def finger(self, channel: str) -> FingerPort:
        """The finger port of a channel; BadInput if there is none of that name."""
        if channel not in self.channels:
            raise BadInput(f"channel {channel!r} is not there; allowed: {', '.join(self.channels)}")
        return self._ports[self.channels.index(channel)]

    def _forces(self, count: int) -> NDArray[np.float64] | None:
        if not any(port._pressed_v.size for port in self._ports):
            return None
        forces = [port._take_force(count) for port in self._ports]
        return np.stack([np.zeros(count) if force is None else force for force in forces], axis=1)

    def _trace(self, block: SimulatedBlock, reference: NDArray[np.float64]) -> Trace:
        for index, port in enumerate(self._ports):
            port._feel(block.displacement_mm[:, index])
        return Trace(self.rate_hz, self.channels, reference, block.command_v, block.position_v, block.saturated)

"""Actuators that no rational model is behind: a cantilever driven at its tip by a coil with eddy currents.

The beam is Euler and Bernoulli's with structural damping, solved in closed form (Timoshenko, Vibration Problems in
Engineering, chapter 5): infinitely many modes and antiresonances. The coil has an inductance that grows as the root of
frequency does, as eddy currents make it.
"""

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray

_FIRST_ROOT = 1.87510407


@dataclass(frozen=True)
class Beam:
    """A beam: its first resonance, loss factor, the coil's corner and share of eddy currents, the gain at rest."""

    first_hz: float = 60.0
    loss: float = 0.08
    coil_hz: float = 900.0
    eddy: float = 0.05
    gain: float = 0.3

    def response(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return the tip's displacement (sensor volts) by the command, at `frequency_hz`, (n,)."""
        stiff = 1.0 + 1j * self.loss
        b = _FIRST_ROOT * np.sqrt(frequency_hz / self.first_hz) / stiff**0.25
        bent = np.sin(b) * np.cosh(b) - np.cos(b) * np.sinh(b)
        tip = 3.0 * bent / (b**3 * (1.0 + np.cos(b) * np.cosh(b))) / stiff
        turn = 1j * frequency_hz / self.coil_hz
        return np.asarray(self.gain * tip / (1.0 + turn + self.eddy * np.sqrt(turn)))


def drawn(rng: np.random.Generator) -> Beam:
    """Return a beam with one to three modes below 300 Hz."""
    return Beam(
        first_hz=float(rng.uniform(25.0, 120.0)),
        loss=float(rng.uniform(0.06, 0.2)),
        coil_hz=float(rng.uniform(300.0, 2000.0)),
        eddy=float(rng.uniform(0.0, 0.2)),
    )

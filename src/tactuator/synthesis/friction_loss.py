"""Loss of a sinusoid to friction, to first order: the describing function of Dahl's model.

Dahl friction of Coulomb level F (volts of command) that builds up over the distance x0 (volts of sensor) describes,
between -Y and Y, the branches

    f(x) = F - (F + f_m) exp(-(x + Y)/x0) going up, its mirror image going down, f_m = F tanh(Y/x0).

Its first harmonic D(Y), against a motion of amplitude Y and phase zero, enters the loop as a disturbance of the
command: H r = Y + P S D.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.model.description import Channel
from tactuator.signals.decibels import db, from_db
from tactuator.signals.loop import TwoDegreeLoop

_ANGLES = (np.arange(256) + 0.5) * (np.pi / 256.0)


def dahl_harmonic(amplitude_v: FloatArray, friction_v: float, presliding_v: float) -> NDArray[np.complex128]:
    """Return the first harmonic of the friction (volts of command, complex, against x = Y cos) for amplitudes (n,) in
    volts.
    """
    size = np.maximum(np.asarray(amplitude_v, dtype=np.float64)[:, None], 1e-12 * presliding_v)
    reached = friction_v * np.tanh(size / presliding_v)
    # going down from +Y: x = Y cos(angle), angle 0..pi; the way up is its mirror image
    way = size * (1.0 - np.cos(_ANGLES))
    force = -friction_v + (friction_v + reached) * np.exp(-way / presliding_v)
    return np.asarray(2.0 * np.mean(force * np.exp(-1j * _ANGLES), axis=1))


def friction_loss_db(channel: Channel, loop: TwoDegreeLoop, frequency_hz: FloatArray, level_db_sl: float) -> FloatArray:
    """Return the loss, dB, shape (n,), by which a sinusoid of `level_db_sl` at `frequency_hz` moves less than its
    reference.

    From the friction that the display file states; negative where the spring of presliding adds to the motion.
    """
    position = channel.threshold_voltage(frequency_hz) * from_db(level_db_sl)
    environment = channel.environment
    harmonic = dahl_harmonic(position, environment.friction_v, environment.presliding_v)
    path = loop.plant.response(frequency_hz) if loop.feedback is None else loop.feedback.load_sensitivity(frequency_hz)
    return db(1.0 + path * harmonic / position)

"""A motor with dry friction that shares nothing with the identification: motion by Runge and Kutta."""

import numpy as np

RATE_HZ = 2500.0
GAIN, DAMPING, STIFFNESS = 5200.0, 60.0, 900.0


def rubbing_motor(coulomb: float, presliding: float, seed: int, seconds: float = 8.0) -> tuple[np.ndarray, np.ndarray]:
    """Return command and position of GAIN/(s² + DAMPING s + STIFFNESS) with Dahl's friction, ten steps a sample."""
    random = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    command = 0.6 * np.sign(np.sin(2 * np.pi * 0.45 * time + random.uniform(0, 6)))
    for frequency in np.geomspace(0.3, 300.0, 26):
        command += random.uniform(0.13, 0.26) * np.cos(2 * np.pi * frequency * time + random.uniform(0, 6))
    position = np.empty(time.size)
    state = np.zeros(3)
    for index, asked in enumerate(command.tolist()):
        position[index] = state[0]
        state = _next_sample(state.tolist(), asked, coulomb, coulomb / presliding)
    return command, position + 3e-4 * random.standard_normal(time.size)


def true_response(frequency_hz: np.ndarray) -> np.ndarray:
    """Return the motor's response without friction."""
    s = 2j * np.pi * np.asarray(frequency_hz)
    return GAIN / (s * s + DAMPING * s + STIFFNESS)


def _next_sample(state: list[float], asked: float, coulomb: float, slope: float) -> np.ndarray:
    def rates(x: float, v: float, z: float) -> tuple[float, float, float]:
        return v, GAIN * (asked - z) - DAMPING * v - STIFFNESS * x, slope * (v - abs(v) * z / coulomb)

    x, v, z = state
    h = 1.0 / RATE_HZ / 10
    for _ in range(10):
        a = rates(x, v, z)
        b = rates(x + h / 2 * a[0], v + h / 2 * a[1], z + h / 2 * a[2])
        c = rates(x + h / 2 * b[0], v + h / 2 * b[1], z + h / 2 * b[2])
        d = rates(x + h * c[0], v + h * c[1], z + h * c[2])
        x += h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        v += h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        z += h / 6 * (a[2] + 2 * b[2] + 2 * c[2] + d[2])
    return np.array([x, v, z])

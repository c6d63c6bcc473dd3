"""A motor with Coulomb friction under position control, integrated with steps of its own: implicit in the friction."""

import numpy as np
from scipy import signal


def motor(rng, duration_s=12.0, rate_hz=1000.0, steps=20):
    """(truth, command, position): P-D control of a noisy position along smooth random moves; the command is held."""
    gain, damping = np.exp(rng.uniform(np.log(0.2), np.log(5.0))), np.exp(rng.uniform(np.log(0.5), np.log(8.0)))
    count, h = round(duration_s * rate_hz), 1.0 / rate_hz / steps
    levels = np.repeat(rng.uniform(-1.0, 1.0, count // 700 + 1), 700)[:count]
    reference = signal.sosfilt(signal.butter(4, 1.5 / (0.5 * rate_hz), output="sos"), levels)
    reference *= 0.2 / np.max(np.abs(reference))
    speed = np.gradient(reference) * rate_hz
    usual = (np.std(np.gradient(speed) * rate_hz) + damping * np.std(speed)) / gain
    coulomb = usual * rng.uniform(0.3, 2.0)
    offset = coulomb * rng.uniform(0.1, 0.3)
    wide, edge = 2.0 * np.pi * rng.uniform(3.0, 8.0), 1e-3 * np.std(speed)
    noise = rng.standard_normal(count) * np.std(reference) * 10.0 ** (-rng.uniform(60.0, 75.0) / 20.0)
    command, position, x, v, last, slope = np.zeros(count), np.zeros(count), 0.0, 0.0, None, 0.0
    for k in range(count):
        position[k] = x + noise[k]
        raw = 0.0 if last is None else (position[k] - last) * rate_hz
        last, slope = position[k], slope + 0.2 * (raw - slope)
        command[k] = wide**2 / gain * (reference[k] - position[k]) - 1.4 * wide / gain * slope
        for _ in range(steps):
            w = v
            for _ in range(3):
                rub = np.tanh(w / edge)
                off = w - v - h * (gain * (command[k] - offset - coulomb * rub) - damping * w)
                w -= off / (1.0 + h * (gain * coulomb * (1.0 - rub * rub) / edge + damping))
            v, x = w, x + h * w
    return {"gain": gain, "damping": damping, "coulomb": coulomb, "offset": offset}, command, position

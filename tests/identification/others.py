"""Records as others make them: continuous plants, exact between samples, real anti-aliasing filter, open and closed.

Nothing here is the package's. Band-limited records are computed on a grid 50 times finer than their samples, with an
elliptic filter of eight poles before each converter; held ones by scipy's matrix exponential, dead time included.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg, signal

OVER = 50


@dataclass(frozen=True, eq=False)
class Plant:
    """gain * prod(1 - s/zero) / prod(1 - s/pole) * exp(-s delay_s), rad/s."""

    zeros: np.ndarray
    poles: np.ndarray
    gain: float
    delay_s: float

    def response(self, frequency_hz):
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
        value = self.gain * np.exp(-s * self.delay_s)
        for zero in self.zeros:
            value = value * (1.0 - s / zero)
        for pole in self.poles:
            value = value / (1.0 - s / pole)
        return value

    def polynomials(self):
        top = np.real(np.poly(self.zeros)) / np.real(np.prod(-self.zeros))
        under = np.real(np.poly(self.poles))
        return self.gain * np.real(np.prod(-self.poles)) * np.atleast_1d(top), under


def random_plant(rng, rate_hz):
    """Two or three poles, resonance 20 to 200 Hz, Q 0.5 to 30, with and without a zero, dead time 0 to 3 ms."""
    hertz = np.exp(rng.uniform(np.log(20.0), np.log(min(200.0, 0.35 * rate_hz))))
    q, size = np.exp(rng.uniform(np.log(0.5001), np.log(30.0))), 2.0 * np.pi * hertz
    real, turn = -size / (2.0 * q), size * np.sqrt(max(1.0 - 0.25 / q**2, 0.0))
    poles, zeros = [real + 1j * turn, real - 1j * turn], []
    third = rng.uniform() < 0.5
    if third:
        poles.append(-size * np.exp(rng.uniform(np.log(0.3), np.log(3.0))))
    if rng.uniform() < 0.5:
        while True:
            zero = -size * np.exp(rng.uniform(np.log(0.3), np.log(3.0)))
            if not third or abs(np.log(zero / poles[2].real)) > 0.7:
                break
        if q < 0.7 and abs(np.log(-zero / size)) < 0.5:
            zero = -size * np.exp(0.7)
        zeros.append(zero)
    delay = rng.uniform(0.0, 3e-3) if rng.uniform() < 0.6 else 0.0
    return Plant(np.array(zeros), np.array(poles), float(np.exp(rng.uniform(-2.0, 2.0))), delay)


def filter_response(frequency_hz, rate_hz):
    """The analogue filter before a converter: passes to 0.4 of the rate, 80 dB down from half of it."""
    zeros, poles, gain = signal.ellip(8, 0.05, 80, 2.0 * np.pi * 0.40 * rate_hz, analog=True, output="zpk")
    s = 2j * np.pi * frequency_hz
    value = np.full(frequency_hz.shape, gain, dtype=complex)
    for zero in zeros:
        value = value * (s - zero)
    for pole in poles:
        value = value / (s - pole)
    return value


def _regulator(plant, rng, rate_hz, held):
    """Gain and corner of a PI controller with a largest sensitivity of 2."""
    frequency = np.geomspace(0.05, 0.45 * rate_hz, 4000)
    corner = abs(plant.poles[0]) * rng.uniform(0.1, 0.5)
    s = 2j * np.pi * frequency
    shape = plant.response(frequency) * (1.0 + corner / s) * (np.exp(-s * 0.5 / rate_hz) if held else 1.0)
    gain = 20.0 / plant.gain
    for _ in range(200):
        loop = gain * shape
        behind = np.unwrap(np.angle(loop)) < -np.pi
        if np.min(np.abs(1.0 + loop)) > 0.5 and np.all(np.abs(loop[behind]) < 0.7):
            break
        gain *= 0.9
    return gain * rng.uniform(0.5, 1.0), corner


def band_limited(plant, rng, rate_hz, duration_s, noise_db, closed=False, with_reference=False):
    """Command and position (and the loop's reference) behind their filters.

    noise_db: the sensor's noise below the position, inside the loop.
    """
    count, warm = round(duration_s * rate_hz), round(min(2.0, duration_s) * rate_hz)
    total = (count + warm) * OVER
    frequency = np.fft.rfftfreq(total, 1.0 / (rate_hz * OVER))
    top = min(3.0 * rate_hz, 0.5 * rate_hz * OVER)
    inside = (frequency > 0.0) & (frequency <= top)

    def white():
        return np.where(inside, rng.standard_normal(frequency.size) + 1j * rng.standard_normal(frequency.size), 0.0)

    source, noise = white() / np.sqrt(1.0 + (frequency / (0.7 * rate_hz)) ** 4), white()
    seen, answer = filter_response(frequency, rate_hz), plant.response(frequency)
    s = 2j * np.pi * np.where(frequency > 0.0, frequency, 1.0)
    if closed:
        gain, corner = _regulator(plant, rng, rate_hz, False)
        control = gain * (1.0 + corner / s) / (1.0 + s / (2.0 * np.pi * 5.0 * rate_hz))
    else:
        control = np.ones(frequency.size)
    sensitivity = 1.0 / (1.0 + answer * control) if closed else np.ones(frequency.size)
    clean = answer * control * sensitivity * source
    level = np.sqrt(np.sum(np.abs(clean * seen) ** 2) / np.sum(np.abs(noise * seen) ** 2)) * 10.0 ** (-noise_db / 20.0)
    fed = level * noise if closed else 0.0
    command = control * sensitivity * (source - fed)
    position = clean + sensitivity * level * noise
    wanted = (command, position, source) if with_reference else (command, position)
    return tuple(np.fft.irfft(np.where(inside, one, 0.0) * seen, total)[::OVER][warm:] for one in wanted)


def _steps(plant, rate_hz):
    num, den = plant.polynomials()
    a, b, c, _ = signal.tf2ss(num, den)
    n = a.shape[0]

    def held_for(duration_s):
        block = np.zeros((n + 1, n + 1))
        block[:n, :n], block[:n, n:] = a * duration_s, b * duration_s
        whole = linalg.expm(block)
        return whole[:n, :n], whole[:n, n]

    whole, part = divmod(plant.delay_s * rate_hz, 1.0)
    full, _ = held_for(1.0 / rate_hz)
    rest, now = held_for((1.0 - part) / rate_hz)
    before = rest @ held_for(part / rate_hz)[1] if part > 0.0 else np.zeros(n)
    return full, now, before, c[0], int(whole)


def held(plant, rng, rate_hz, duration_s, noise_db, closed=False):
    """Command held by the converter and position with white noise; closed: a digital PI controller sees that noise."""
    count, warm = round(duration_s * rate_hz), round(min(2.0, duration_s) * rate_hz)
    total = count + warm
    kind = rng.integers(3)
    source = rng.standard_normal(total)
    if kind == 1:
        source = np.repeat(np.sign(source[: total // 2 + 1]), 2)[:total]
    elif kind == 2:
        source = signal.sosfilt(signal.butter(2, 0.5, output="sos"), source)
    full, now, before, c, late = _steps(plant, rate_hz)
    gain, corner = _regulator(plant, rng, rate_hz, True) if closed else (1.0, 0.0)

    @np.errstate(over="ignore", invalid="ignore")  # a loop that runs away is drawn again
    def run(noise):
        state, command, position, summed = np.zeros(c.size), np.zeros(total), np.zeros(total), 0.0
        for k in range(total):
            position[k] = c @ state + noise[k]
            if closed:
                error = source[k] - position[k]
                summed += gain * corner / rate_hz * error
                command[k] = gain * error + summed
            else:
                command[k] = source[k]
            first = command[k - late] if k >= late else 0.0
            state = full @ state + now * first + before * (command[k - late - 1] if k > late else 0.0)
        return command, position

    noise = rng.standard_normal(total)
    clean = run(np.zeros(total))[1]
    command, position = run(noise * 10.0 ** (-noise_db / 20.0) * clean.std())
    return command[warm:], position[warm:]

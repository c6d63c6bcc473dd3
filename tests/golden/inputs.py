"""Records and responses beside the examples, from seeds: what `python -m tests.golden` identifies."""

from pathlib import Path

import numpy as np
import soundfile
from scipy import io, signal

RATE_HZ = 4000.0


def held(poles: list[float], gain: float, rate_hz: float, command: np.ndarray) -> np.ndarray:
    """The answer of gain / poly(poles) to a command that is held between its samples."""
    num, den, _ = signal.cont2discrete(([gain], poles), 1.0 / rate_hz, "zoh")
    return np.asarray(signal.lfilter(num.ravel(), den, command))


def second_order(hertz: float, damping: float) -> list[float]:
    own = 2.0 * np.pi * hertz
    return [1.0, 2.0 * damping * own, own**2]


def excitation(rate_hz: float, seconds: float, seed: int) -> np.ndarray:
    """Steps of several lengths, and noise: 2 V at most."""
    rng, count = np.random.default_rng(seed), int(rate_hz * seconds)
    steps = np.concatenate([np.full(k, rng.uniform(-1.0, 1.0)) for k in rng.integers(4, 600, count // 100)])[:count]
    command = np.resize(steps, count) + 0.4 * rng.standard_normal(count)
    return 2.0 * command / np.abs(command).max()


def write(path: Path, names: str, *columns: np.ndarray) -> None:
    np.savetxt(path, np.column_stack(columns), fmt="%.8g", delimiter=",", header=names, comments="")


def closed_loop(rate_hz: float, seconds: float, seed: int) -> tuple[np.ndarray, ...]:
    """Reference, command and position of a resonance under a PI controller, with noise at the sensor."""
    rng, count = np.random.default_rng(seed), int(rate_hz * seconds)
    den = second_order(60.0, 0.3)
    num, poles, _ = signal.cont2discrete(([0.5 * den[2]], den), 1.0 / rate_hz, "zoh")
    b, a = num.ravel(), poles
    reference = 0.5 * np.repeat(rng.uniform(-1.0, 1.0, count // 50 + 1), 50)[:count]
    reference += 0.1 * np.repeat(np.sign(rng.standard_normal(count // 8 + 1)), 8)[:count]
    command, position, summed, x = np.zeros(count), np.zeros(count), 0.0, np.zeros(2)
    for k in range(count):
        position[k] = x[0] + 1e-3 * rng.standard_normal()
        error = reference[k] - position[k]
        summed += 150.0 * error / rate_hz
        command[k] = 1.5 * error + summed
        x = np.array([b[1] * command[k] - a[1] * x[0] + x[1], b[2] * command[k] - a[2] * x[0]])
    return reference, command, position


def rubbing_motor(seconds: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Force and position at 1 kHz of a motor of 2 kg with Dahl's friction under position control; 20 steps a sample."""
    rng, count, h = np.random.default_rng(seed), int(1000 * seconds), 1.0 / 20000.0
    mass, viscous, coulomb, presliding = 2.0, 8.0, 6.0, 1e-4
    goal = np.cumsum(np.repeat(rng.uniform(-0.6, 0.6, count // 400 + 1), 400)[:count]) / 1000.0
    goal = signal.sosfiltfilt(signal.butter(2, 6.0, fs=1000.0, output="sos"), goal)
    force, position, x, v, z, before, push = np.zeros(count), np.zeros(count), 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        position[k], force[k] = x + 1e-6 * rng.standard_normal(), push
        for _ in range(20):
            gone = v * h / presliding
            z = (z + gone) / (1.0 + abs(gone))
            v += h / mass * (push - viscous * v - coulomb * z)
            x += h * v
        push = mass * 220.0 * (40.0 * (goal[k] - position[k]) - (position[k] - before) * 1000.0)
        before = position[k]
    return force, position


def make(folder: Path) -> None:
    """Write them all into a folder."""
    rng = np.random.default_rng(5)
    command = excitation(RATE_HZ, 3.0, 1)
    time, den = np.arange(command.size) / RATE_HZ, second_order(60.0, 0.3)
    clean = held(den, 0.5 * den[2], RATE_HZ, command)
    position = clean + 2e-4 * rng.standard_normal(command.size)
    names = "time_s,command_v,position_v"
    write(folder / "resonator.csv", names, time, command, position)
    write(folder / "clipped.csv", names, time, command, np.clip(position, -0.35, 0.35))
    kept = np.r_[0:5000, 5060 : time.size]
    write(folder / "lost.csv", names, time, command, np.r_[position[kept], np.zeros(60)])
    write(folder / "two-clocks.csv", names, time, command, np.interp(time * 1.0004, time, position))
    write(folder / "constant.csv", names, time, np.ones(time.size), position)
    write(folder / "reversed.csv", names, time, command, -position)
    soundfile.write(folder / "record.wav", 0.3 * np.column_stack([command, position]), int(RATE_HZ), subtype="FLOAT")
    io.savemat(folder / "record.mat", {"run": {"u": command, "y": position, "t": time}})
    quick = excitation(8000.0, 3.0, 2)
    modes = np.polymul(second_order(40.0, 0.2), second_order(310.0, 0.03))
    late = np.r_[np.zeros(8), held(list(modes), 0.4 * modes[-1], 8000.0, quick)[:-8]]
    write(
        folder / "modes.csv", names, np.arange(quick.size) / 8000.0, quick, late + 1e-4 * rng.standard_normal(late.size)
    )
    velocity = np.gradient(clean, time) / 0.2
    write(
        folder / "velocity.csv",
        "time_s,command_v,velocity_mm_s",
        time,
        command,
        velocity + 0.01 * rng.standard_normal(time.size),
    )
    reference, driven, seen = closed_loop(2000.0, 5.0, 3)
    write(
        folder / "loop.csv",
        "time_s,reference,command_v,position_v",
        np.arange(seen.size) / 2000.0,
        reference,
        driven,
        seen,
    )
    force, moved = rubbing_motor(8.0, 4)
    write(folder / "motor.csv", "time_s,force_n,position_m", np.arange(force.size) / 1000.0, force, moved)
    hertz = np.geomspace(20.0, 900.0, 80)
    s, own = 2j * np.pi * hertz, 2.0 * np.pi * 175.0
    answer = 0.02 * own**2 / (s**2 + own / 15.0 * s + own**2) * np.exp(-1e-3 * s)
    answer *= 1.0 + 0.003 * rng.standard_normal(hertz.size)
    level, phase = 20.0 * np.log10(np.abs(answer)), np.degrees(np.unwrap(np.angle(answer)))
    write(folder / "response.csv", "frequency_hz,magnitude_db,phase_deg", hertz, level, phase)
    write(folder / "magnitude.csv", "frequency_hz,magnitude_db", hertz, level)
    write(
        folder / "confident.csv",
        "frequency_hz,magnitude_db,phase_deg,confidence_db",
        hertz,
        level,
        phase,
        np.full(80, 0.05),
    )

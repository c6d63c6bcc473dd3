"""Motors with friction under position control, simulated in steps of a fiftieth of a millisecond; NumPy alone.

Friction is a bristle (Canudas de Wit and others, 1995) with Stribeck's fall and with other levels and slopes in either
direction: laws that the identification's model does not have. All motors are stepped at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

RATE_HZ = 1000.0
Values = NDArray[np.float64]


@dataclass(frozen=True)
class Motors:
    """Constants of motors, (k,) each: mass; viscous damping, mean of both directions; Coulomb level, likewise.

    asymmetry: of viscous damping and of the level, a share, (2, k). breakaway: what Stribeck's law adds at rest, of the
    level. stribeck: speed over which it fades. presliding: distance over which friction builds up. speed: of the
    motion. stiffness: of the spring that holds it, zero: none.
    """

    mass: Values
    viscous: Values
    coulomb: Values
    asymmetry: Values
    breakaway: Values
    stribeck: Values
    presliding: Values
    speed: Values
    stiffness: Values


def drawn(rng: np.random.Generator, count: int, *, sprung: bool = False) -> Motors:
    """Return motors drawn over three decades of mass and speed; sprung: held by a spring, less damped, rubbing less."""
    mass, speed = 10.0 ** rng.uniform(-1.5, 2.0, count), 10.0 ** rng.uniform(-2.0, 1.0, count)
    # the motion's changes of speed take about a fifth of a second
    coulomb = rng.uniform(0.3, 1.5, count) * mass * speed / 0.2
    if sprung:
        omega = 2.0 * np.pi * rng.uniform(4.0, 20.0, count)
        # in shares of the force that brings the speed at resonance
        coulomb = rng.uniform(0.02, 0.15, count) * mass * omega * speed
        viscous = 2.0 * mass * omega * rng.uniform(0.2, 1.0, count)
    else:
        omega, viscous = np.zeros(count), rng.uniform(0.2, 1.5, count) * coulomb / speed
    return Motors(
        mass=mass,
        viscous=viscous,
        coulomb=coulomb,
        asymmetry=rng.uniform(-0.15, 0.15, (2, count)),
        breakaway=rng.uniform(0.05, 0.5, count),
        stribeck=rng.uniform(0.02, 0.2, count) * speed,
        presliding=speed * 10.0 ** rng.uniform(-4.5, -3.5, count),
        speed=speed,
        stiffness=mass * omega**2,
    )


def reference(rng: np.random.Generator, speed: Values, seconds: float) -> Values:
    """Return where the motors are asked to be, (n, k): moves of many lengths that begin and end smoothly."""
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    rows = []
    for fast in speed:
        place, now, velocity = 0.0, 0.3, np.zeros(time.size)
        while now < seconds - 0.3:
            length, lasting = rng.uniform(0.2, 1.0) * fast, rng.uniform(0.15, 0.9)
            sign = -np.sign(place) if abs(place) > 0.3 * fast else rng.choice([-1.0, 1.0])
            edge = rng.uniform(0.05, 0.15)
            rise = np.clip((time - now) / edge, 0.0, 1.0) - np.clip((time - now - lasting - edge) / edge, 0.0, 1.0)
            velocity += sign * length * 0.5 * (1.0 - np.cos(np.pi * rise))
            place += sign * length * (lasting + edge)
            now += lasting + 2.0 * edge + rng.choice([0.0, rng.uniform(0.0, 0.2)])
        rows.append(np.cumsum(velocity) / RATE_HZ)
    return np.stack(rows, axis=1)


def pushed(rng: np.random.Generator, motors: Motors, seconds: float) -> Values:
    """Return the forces that drive sprung motors, (n, k): steps and tones from 0.3 to 300 Hz."""
    time = np.arange(round(seconds * RATE_HZ))[:, None] / RATE_HZ
    turns = rng.uniform(0.0, 2.0 * np.pi, (27, motors.mass.size))
    force = 0.6 * np.sign(np.sin(2.0 * np.pi * 0.45 * time + turns[0]))
    for hertz, turn in zip(np.geomspace(0.3, 300.0, 26), turns[1:], strict=True):
        force += rng.uniform(0.13, 0.26) * np.cos(2.0 * np.pi * hertz * time + turn)
    return np.asarray(force * motors.speed * np.sqrt(motors.mass * motors.stiffness))


def recorded(motors: Motors, rng: np.random.Generator, seconds: float = 20.0, steps: int = 20) -> tuple[Values, Values]:
    """Return forces, held between samples, and positions of all motors, (n, k) each: free ones in a cascade of two
    loops, sprung ones in none.
    """
    is_sprung = bool(np.all(motors.stiffness > 0.0))
    asked = pushed(rng, motors, seconds) if is_sprung else reference(rng, motors.speed, seconds)
    count, step = motors.mass.size, 1.0 / RATE_HZ / steps
    outer = 2.0 * np.pi * rng.uniform(4.0, 10.0, count)
    inner = motors.mass * 2.0 * np.pi * rng.uniform(20.0, 50.0, count)
    code, noise = motors.speed * 10.0 ** rng.uniform(-6.0, -4.5, (2, count))
    x, v, z = np.zeros((3, count))
    seen_before, force = np.zeros(count), np.zeros(count)
    forces, positions = np.empty_like(asked), np.empty_like(asked)
    levels = [motors.coulomb * (1.0 + way * motors.asymmetry[1]) for way in (-1.0, 1.0)]
    slopes = [motors.viscous * (1.0 + way * motors.asymmetry[0]) for way in (-1.0, 1.0)]
    bristle = motors.coulomb / motors.presliding
    for n, goal in enumerate(asked):
        seen = code * np.round((x + noise * rng.standard_normal(count)) / code)
        # the force was worked out from the sample before, and is held over this period
        forces[n], positions[n] = force, seen
        later = goal if is_sprung else inner * (outer * (goal - seen) - (seen - seen_before) * RATE_HZ)
        seen_before = seen
        for _ in range(steps):
            level = np.where(v > 0.0, levels[1], levels[0])
            whole = level * (1.0 + motors.breakaway * np.exp(-((v / motors.stribeck) ** 2)))
            most = whole / bristle
            fade = np.exp(-np.abs(v) * step / most)
            z = np.sign(v) * most * (1.0 - fade) + z * fade
            slope = np.where(v > 0.0, slopes[1], slopes[0])
            # the trapezoid's rule: damping is implicit, the position moves by the mean speed
            half = 0.5 * step * slope / motors.mass
            later_v = (v * (1.0 - half) + step / motors.mass * (force - motors.stiffness * x - bristle * z)) / (
                1.0 + half
            )
            x, v = x + 0.5 * step * (v + later_v), later_v
        force = later
    return forces, positions

"""Mass, damping and stiffness of what touches a display, and whether they describe it.

Each realisation gives an estimate of its own, so that the confidence needs no model of the noise: Student's t over
the realisations. Lines count by their scatter between realisations. The one mass, damper and spring is held against a
Kelvin-Voigt chain of two: a contact mass, a damper and spring to a second mass, a damper and spring from there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.load import Load

ONE, CHAIN, NEITHER, CANNOT_TELL = "one", "chain", "neither", "cannot tell"
FELT_ALIKE_DB = 0.25
"""A misfit that changes what is felt by no more than this does not speak against one mass, damper and spring."""
_SURE = 0.99
_MODEL_SHARE = 1e-3
"""Share of a figure that the model leaves open however long is played: images of the held command, and what friction
does differently under a finger."""
_STARTS_HZ = (60.0, 120.0, 240.0)


@dataclass(frozen=True)
class FingerEstimate:
    """Estimate of what touches a channel: figures in a load's units, their 95 % half-widths, and what describes it.

    described_by: "one" mass, damper and spring; a "chain" of two; "neither"; or "cannot tell", where a half-width of
    mass or damping is more than half of it, or a reading came to its end (saturated). misfit_db: by how much the misfit
    of the one changes the felt level, at most. excess, chain_excess: squared misfit over what chance leaves in 99 of
    100, of the one and of the chain. chain: its mass, damping, stiffness and the second's, fitted; empty where the one
    is within chance.
    """

    channel: str
    mass: float
    damping: float
    stiffness: float
    half_width: tuple[float, float, float]
    described_by: str
    misfit_db: float
    excess: float
    chain_excess: float | None
    chain: tuple[float, ...]
    realisations: int
    saturated: bool

    @property
    def load(self) -> Load:
        """Return the load of a display file; a figure below zero, which noise can bring about, is zero."""
        return Load("finger", max(self.mass, 0.0), max(self.damping, 0.0), max(self.stiffness, 0.0))


def one_impedance(figures: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
    """Return m s^2 + b s + k at `frequency_hz` (n,) for figures (3,)."""
    s = 2j * np.pi * frequency_hz
    return np.asarray(figures[0] * s**2 + figures[1] * s + figures[2])


def chain_impedance(figures: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
    """Return the impedance of a chain of two at `frequency_hz` (n,): figures (6,), mass, damping, stiffness of the
    contact and of what is behind it."""
    s = 2j * np.pi * frequency_hz
    m, b, k, behind_m, behind_b, behind_k = figures
    link, behind = b * s + k, behind_m * s**2 + behind_b * s + behind_k
    return np.asarray(m * s**2 + link * behind / (link + behind))


def estimate_finger(
    channel: str, frequency_hz: FloatArray, impedance: ComplexArray, felt_per_impedance: ComplexArray, saturated: bool
) -> FingerEstimate:
    """Return what describes an impedance (realisations, m) at `frequency_hz` (m,).

    felt_per_impedance: change of the felt level, as a factor less one, for a small impedance more, (m,).
    """
    count = impedance.shape[0]
    mean = impedance.mean(axis=0)
    scatter = np.sum(np.abs(impedance - mean) ** 2, axis=0) / (count - 1)
    weight = 1.0 / np.sqrt(np.maximum(scatter, 1e-24 * np.max(np.abs(mean)) ** 2))
    each = np.array([_fit_one(frequency_hz, one, weight) for one in impedance])
    figures = each.mean(axis=0)
    half = stats.t.ppf(0.975, count - 1) * each.std(axis=0, ddof=1) / np.sqrt(count)
    half = np.hypot(half, _MODEL_SHARE * figures)
    missed = mean - one_impedance(figures, frequency_hz)
    excess = _excess(missed * weight, count, 1.5)
    chain, chain_excess = np.zeros(0), None
    if excess > 1.0:
        chain = _fit_chain(frequency_hz, mean, weight, figures)
        chain_excess = _excess((mean - chain_impedance(chain, frequency_hz)) * weight, count, 3.0)
    misfit_db = float(np.max(np.abs(20.0 * np.log10(np.abs(1.0 + felt_per_impedance * missed)))))
    if saturated or np.any(half[:2] > 0.5 * np.abs(figures[:2])):
        described_by = CANNOT_TELL
    elif chain_excess is None or misfit_db <= FELT_ALIKE_DB:
        described_by = ONE
    else:
        described_by = CHAIN if chain_excess <= max(1.0, 0.1 * excess) else NEITHER
    mass, damping, stiffness = figures.tolist()
    wide = (float(half[0]), float(half[1]), float(half[2]))
    return FingerEstimate(
        channel, mass, damping, stiffness, wide, described_by, misfit_db, excess, chain_excess,
        tuple(chain.tolist()), count, saturated,
    )  # fmt: skip


def _fit_one(frequency_hz: FloatArray, impedance: ComplexArray, weight: FloatArray) -> FloatArray:
    """Return m, b, k by weighted least squares, (3,)."""
    s = 2j * np.pi * frequency_hz
    columns = np.stack([s**2, s, np.ones_like(s)], axis=1) * weight[:, None]
    aim = impedance * weight
    size = np.linalg.norm(columns, axis=0)
    stacked = np.vstack([columns.real, columns.imag]) / size
    return np.asarray(np.linalg.lstsq(stacked, np.concatenate([aim.real, aim.imag]), rcond=None)[0] / size)


def _fit_chain(frequency_hz: FloatArray, mean: ComplexArray, weight: FloatArray, one: FloatArray) -> FloatArray:
    """Return the chain of two nearest to an impedance, (6,), by descent in the figures' logarithms from three starts:
    a third of the mass at the contact, the rest behind a spring that resonates at different frequencies."""

    def off(logs: FloatArray) -> FloatArray:
        left = (chain_impedance(np.exp(logs), frequency_hz) - mean) * weight
        return np.concatenate([left.real, left.imag])

    mass, damping, stiffness = np.maximum(np.abs(one), 1e-6 * np.max(np.abs(one)))
    best = None
    for hertz in _STARTS_HZ:
        behind = mass / 1.5
        spring = behind * (2.0 * np.pi * hertz) ** 2
        start = np.log([mass / 3.0, np.sqrt(spring * behind), spring, behind, damping, stiffness])
        found = optimize.least_squares(off, start, bounds=(start - 7.0, start + 7.0), max_nfev=200)
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    return np.asarray(np.exp(best.x))


def _excess(missed: ComplexArray, realisations: int, used: float) -> float:
    """Return the sum of squared misfit against its scatter, (m,) weighted by that of one realisation, over what it
    stays below in 99 of 100. used: complex figures that were fitted.

    Each term is Fisher's F with 2 and 2 (n - 1) degrees of freedom, their sum nearly a gamma variable.
    """
    below = 2.0 * (realisations - 1)
    mean = below / (below - 2.0)
    variance = below**3 / ((below - 2.0) ** 2 * (below - 4.0))
    most = stats.gamma.ppf(_SURE, (missed.size - used) * mean**2 / variance, scale=variance / mean)
    return float(np.sum(np.abs(missed) ** 2) * realisations / most)

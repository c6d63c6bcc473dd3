"""Refinement of a belief from all trials together, against the integral over a grid of both thresholds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.experiment.procedure.curve_belief import CurveBelief, PointLikelihoods, Sites, refine
from tactuator.experiment.procedure.curve_prior import CurvePrior
from tactuator.experiment.procedure.procedure import Answering

ANSWERING = Answering(slopes=(2.0,), lapses=(0.05,), lapse_shares=(1.0,))
MEAN, COVARIANCE = np.array([2.0, 3.0]), np.array([[25.0, 15.0], [15.0, 36.0]])


def trials(
    seed: int, covariance: np.ndarray = COVARIANCE, count: int = 40
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    truth = rng.multivariate_normal(MEAN, covariance)
    point = rng.integers(2, size=count)
    level = np.round(2.0 * (truth[point] + rng.uniform(-4.0, 8.0, count))) / 2.0
    psi = ANSWERING.psi(level - truth[point], np.array(2.0), np.array(0.05))
    return point, level, rng.random(count) < psi


def by_grid(
    point: np.ndarray, level: np.ndarray, correct: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return mean, standard deviation and log evidence by summing over 421 x 421 pairs of thresholds."""
    g = 2.5 + np.linspace(-7.0, 7.0, 421) * np.sqrt(covariance.max())
    pairs = np.stack(np.meshgrid(g, g, indexing="ij"), axis=-1)
    about = pairs - MEAN
    log_prior = -0.5 * np.einsum("abi,ij,abj->ab", about, np.linalg.inv(covariance), about)
    log_prior -= 0.5 * np.log(np.linalg.det(2.0 * np.pi * covariance))
    found = log_prior
    for one, at, right in zip(point, level, correct, strict=True):
        psi = ANSWERING.psi(at - g, np.array(2.0), np.array(0.05))
        each = np.log(psi if right else 1.0 - psi)
        found = found + (each[:, None] if one == 0 else each[None, :])
    highest = found.max()
    density = np.exp(found - highest)
    evidence = highest + float(np.log(density.sum() * (g[1] - g[0]) ** 2))
    density /= density.sum()
    mean = np.array([(density.sum(axis=1 - axis) * g).sum() for axis in (0, 1)])
    sd = np.sqrt([(density.sum(axis=1 - axis) * (g - mean[axis]) ** 2).sum() for axis in (0, 1)])
    return mean, sd, evidence


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.1, 1.0]))
def test_refine__two_points__is_the_integral_over_both(seed: int, scale: float) -> None:
    covariance = scale**2 * COVARIANCE  # 0.1: narrow, as where many other points have told
    point, level, correct = trials(seed, covariance)
    likelihoods = PointLikelihoods(ANSWERING, 1, 2)
    for one, at, right in zip(point, level, correct, strict=True):
        likelihoods.learn(np.array([one]), np.array([at]), np.array([right]))
    nothing = Sites(np.zeros((1, 2)), np.zeros((1, 2)))
    found = refine(MEAN[None], covariance[None], likelihoods.log_likelihood[:, 0], likelihoods.seen, nothing)
    again = refine(MEAN[None], covariance[None], likelihoods.log_likelihood[:, 0], likelihoods.seen, found.sites)
    mean, sd, evidence = by_grid(point, level, correct, covariance)
    assert bool(again.settled[0])
    assert np.max(np.abs(again.mean[0] - mean) / sd) <= 0.15
    assert np.sqrt(np.diag(again.covariance[0])) == pytest.approx(sd, rel=0.12)
    assert float(again.log_evidence[0]) == pytest.approx(evidence, abs=0.15)


def test_belief__same_trials_in_another_order__ends_as_the_same_curve() -> None:
    """Learnt one by one, a lucky guess at the start weighs otherwise than at the end; refined, it does not."""
    prior = CurvePrior(points=6, steps_share=0.0, notch_share=0.0, edge_share=0.0, mains_hz=0.0)
    rng = np.random.default_rng(4)
    point, level = rng.integers(6, size=50), rng.integers(-4, 14, size=50).astype(float)
    correct = rng.random(50) < ANSWERING.psi(level - 3.0, np.array(2.0), np.array(0.05))
    level[0], correct[0] = -20.0, True  # a lucky guess
    beliefs = [CurveBelief(prior, ANSWERING) for _ in range(2)]
    for belief, order in zip(beliefs, (np.arange(50), np.arange(50)[::-1]), strict=True):
        for at in order:
            belief.learn(point[at : at + 1], level[at : at + 1], correct[at : at + 1])
    (one, one_sd), (other, other_sd) = (belief.curve(prior.frequency_hz) for belief in beliefs)
    assert np.max(np.abs(one - other)) <= 0.1
    assert one_sd == pytest.approx(other_sd, rel=0.05)

"""The paper's way: recursive least squares with forgetting, on filtered derivatives, straight to a continuous model.

With E(s) of the model's order, A y = B u becomes an equation in signals that can be had without differentiating noise:
    s^n/E y = - sum a_k s^k/E y + sum b_k s^k/E u
Sensor noise is in the regressors on the right, so the estimate is biased; `refined` is not. E is a guess at first and
the estimated A afterwards, which makes the bias small, not zero (Young, Recursive Estimation, 2011, chapter 8).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.identification import trust
from tactuator.identification.check import (
    EmpiricalResponse,
    Prepared,
    empirical_response,
    moved_range,
    require_excitation,
    valid_range,
)
from tactuator.identification.fit import estimate_of_model
from tactuator.identification.friction import friction_shown
from tactuator.identification.hold import HOLDS, Hold
from tactuator.identification.judge import identification
from tactuator.identification.result import Identification
from tactuator.identification.uncertainty import fit_of_model, log_slopes
from tactuator.model.plant import DERIVATIVES
from tactuator.signals.discretise import first_order, held_matrices
from tactuator.signals.systems import ContinuousSystem

_PASSES = 3
"""How often E is replaced by the estimate before."""


def recursive(common: Prepared) -> Identification:
    """Return the paper's estimate, judged by the same checks as a refined one.

    It has neither friction nor dead time. Its band holds what its form leaves of the record's own response, and by how
    much a friction that shows has moved it.
    """
    (command, position), rate_hz, options = common.signals[0], common.rate_hz, common.options
    order, integrated = options.order or 2, DERIVATIVES[options.quantity]
    if integrated >= order:
        raise BadInput(f"order {order} for a {options.quantity} by least squares", f"{integrated + 1} or more")
    require_excitation(replace(common.excitation, needed=order + 1))
    found = identify_recursively(
        command, position, rate_hz, common.response, poles=order, zeros=integrated, forgetting=options.forgetting
    )
    written = common.records[0].about.get("hold")
    hold: Hold = next((hold for hold in HOLDS if hold in (options.hold, written)), "zero-order")
    sizes = np.append(np.full(integrated + 1, common.gain), np.ones(order))
    covariance = np.zeros((sizes.size + 1, sizes.size + 1))
    covariance[:-1, :-1] = found.covariance * np.outer(sizes, sizes)
    model = common.model(found.num * common.gain, found.den, covariance, method="rls", record={"hold": hold})
    estimate = estimate_of_model(fit_of_model(model, rate_hz, hold, common.gain), common.signals[:1])
    shown = friction_shown(common.signals[:1], estimate)
    result = identification(common, estimate, "asked", fitted=False)
    own = replace(result.model, num=model.num, den=model.den, delay_s=0.0, covariance=covariance, method="rls")
    slopes = log_slopes(estimate.chosen.fit, own.excess.frequency_hz)
    excess = own.excess.joined(slopes @ estimate.chosen.problem.step_of(estimate.chosen.fit))
    if shown is not None:
        level, shift = shown
        excess = excess.joined(slopes @ (level * shift))
        own = own.with_checks(trust.LEFT_OUT.of(100.0 * level))
    own = replace(own, excess=excess)
    return replace(
        result,
        model=replace(own, valid_hz=valid_range(own, moved_range(estimate.spectra))),
        excitation=replace(common.excitation, needed=order + 1),
        tried=(),
        path=found.path * sizes,
    )


@dataclass(frozen=True)
class RecursiveEstimate:
    """A continuous model. num, den: descending powers, den monic. covariance: of (num descending, den[1:]), by least
    squares, hence too small where the residual is coloured. path: the same parameters along the record, (blocks, k).
    """

    num: FloatArray
    den: FloatArray
    covariance: FloatArray
    path: FloatArray

    @property
    def model(self) -> ContinuousSystem:
        """Return the estimate as a system."""
        return ContinuousSystem.from_polynomials(self.num, self.den)


def identify_recursively(
    command: ArrayLike,
    position: ArrayLike,
    rate_hz: float,
    response: EmpiricalResponse | None = None,
    *,
    poles: int = 2,
    zeros: int = 0,
    forgetting: float = 1.0,
) -> RecursiveEstimate:
    """Return the recursive least squares estimate of a model of `poles` and `zeros` on command (n,) and position (n,).

    response: the record's own, if that is at hand; forgetting: as in `recursive_least_squares`. Raises BadInput for an
    unknown structure or a record of fewer than 50 samples.
    """
    u, y = np.asarray(command, dtype=np.float64), np.asarray(position, dtype=np.float64)
    if u.shape != y.shape or u.ndim != 1 or u.size < 50:
        raise BadInput(f"command {u.shape}, position {y.shape}", "one shape (n,), 50 samples or more")
    if not (0 <= zeros < poles <= 6):
        raise BadInput(f"{poles} poles and {zeros} zeros", "1 to 6 poles, fewer zeros")
    corner = _corner(response or empirical_response(u, y, rate_hz), rate_hz)
    filter_polynomial = np.real(np.poly(np.full(poles, -corner)))
    for _ in range(_PASSES):
        regressors, goal, sizes = _regression(filter_polynomial, u, y, rate_hz, zeros)
        theta, inverse, variance, path = recursive_least_squares(regressors, goal, forgetting=forgetting)
        theta = theta / sizes
        filter_polynomial = _as_filter(np.append(1.0, theta[zeros + 1 :]), corner)
    covariance = inverse * (np.outer(1.0 / sizes, 1.0 / sizes) * variance)
    return RecursiveEstimate(theta[: zeros + 1], np.append(1.0, theta[zeros + 1 :]), covariance, path / sizes)


def _corner(response: EmpiricalResponse, rate_hz: float) -> float:
    """Return where the response has fallen to a tenth of its largest value, rad/s: above most poles."""
    trusted = response.coherence > 0.3
    if trusted.sum() < 3:
        return 2.0 * np.pi * rate_hz / 200.0
    frequency, size = response.frequency_hz[trusted], np.abs(response.value[trusted])
    above = np.flatnonzero(size >= 0.1 * size.max())
    return float(2.0 * np.pi * min(frequency[above[-1]], 0.1 * rate_hz))


def _as_filter(den: FloatArray, corner: float) -> FloatArray:
    """Return a stable E from an estimated A: poles mirrored into the left half-plane, none slower than corner/300."""
    poles = np.roots(den)
    poles = -np.abs(poles.real) + 1j * poles.imag
    slow = np.abs(poles) < corner / 300.0
    poles[slow] = -corner / 300.0
    return np.real(np.poly(poles))


def _regression(
    e: FloatArray, u: FloatArray, y: FloatArray, rate_hz: float, zeros: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return regressors and goal scaled to unit size, (n, m+1+poles) and (n,), and the scales of theta."""
    from_u = companion_states(e, u - u.mean(), rate_hz)[: zeros + 1][::-1]
    centred = y - y.mean()
    from_y = companion_states(e, centred, rate_hz, hold="first-order")
    # steady offsets of sensor and command are in no model: slow parts far below the filter's corner are removed alike
    rows = _without_offset(np.vstack([from_u, -from_y[::-1], centred - e[:0:-1] @ from_y]), rate_hz)
    # what went on before the record began dies out with E's own poles
    start = int(min(6.0 * rate_hz / np.min(np.abs(np.roots(e).real)), 0.2 * u.size))
    rows = rows[:, start:]
    size = np.sqrt(np.mean(rows**2, axis=1))
    if size[-1] == 0.0:
        raise BadInput("the position does not move", "a record of something that moves")
    size[size == 0.0] = 1.0
    rows = rows / size[:, None]
    return rows[:-1].T, rows[-1], size[:-1] / size[-1]


def _without_offset(rows: FloatArray, rate_hz: float) -> FloatArray:
    """Apply a first-order high-pass with its corner at 3 periods of the record: it takes offsets away, alike in every
    row (k, n).
    """
    corner = 3.0 * rate_hz / rows.shape[1]
    bent = np.tan(np.pi * min(corner / rate_hz, 0.25))  # by the bilinear transformation
    changes = np.diff(rows, prepend=0.0) / (1.0 + bent)
    return np.stack([first_order((1.0 - bent) / (1.0 + bent), change) for change in changes])


def recursive_least_squares(
    regressors: FloatArray,
    output: FloatArray,
    *,
    forgetting: float = 1.0,
    start_variance: float = 1e8,
    every: int = 500,
) -> tuple[FloatArray, FloatArray, float, FloatArray]:
    """Fit output (count,) by regressors (count, n) from theta = 0, `every` rows at a time, older rows fading.

    Returns theta (n,), the inverse information (n, n), the mean squared residual and the path of theta (blocks, n).
    forgetting: 1 keeps everything, 0.999 halves a sample's weight in 693 samples.
    """
    if not 0.0 < forgetting <= 1.0:
        raise BadInput(f"{forgetting:g}", "above 0, at most 1", key="forgetting")
    size = regressors.shape[1]
    products = np.column_stack([np.eye(size) / start_variance, np.zeros(size)])
    along, fading = list[FloatArray](), forgetting ** np.arange(every)[::-1]
    rows = np.vstack([regressors.T, output])
    for start in range(0, output.size, every):
        block = rows[:, start : start + every]
        count = block.shape[1]
        products = forgetting**count * products + (block[:size] * fading[every - count :]) @ block.T
        along.append(products)
    every_products = np.array(along)
    path = np.linalg.solve(every_products[:, :, :size], every_products[:, :, size:])[:, :, 0]
    rest = output - regressors @ path[-1]
    return path[-1], np.asarray(np.linalg.inv(products[:, :size])), float(np.mean(rest**2)), np.asarray(path)


def companion_states(
    denominator: FloatArray,
    driver: FloatArray,
    rate_hz: float,
    *,
    hold: Literal["zero-order", "first-order"] = "zero-order",
) -> FloatArray:
    """Return s^k/A(s) applied to `driver` (count,) for k = 0 .. n-1: shape (n, count), from rest, exact for the hold.

    denominator: A, descending powers, monic, length n + 1, in rad/s.
    """
    n, ramp = denominator.size - 1, hold == "first-order"
    a, b = np.eye(n, k=1), np.eye(n)[-1]
    a[-1] = -denominator[:0:-1]
    ad, driven = held_matrices(a, b, 1.0 / rate_hz, ramp=ramp)
    # triangular, so that state after state is a filter of first order, however close the poles are
    triangle, turn = scipy.linalg.schur(ad)
    if np.any(np.diagonal(triangle, -1)):
        triangle, turn = scipy.linalg.rsf2csf(triangle, turn)
    inputs = np.stack([driver, np.diff(driver, append=driver[-1])])[: 1 + ramp]
    pushed = turn.conj().T @ (driven.reshape(n, -1) @ inputs)
    states = np.zeros((n, driver.size), dtype=triangle.dtype)
    for k in reversed(range(n)):
        states[k, 1:] = first_order(triangle[k, k], pushed[k] + triangle[k] @ states)[:-1]
    return np.asarray((turn @ states).real)

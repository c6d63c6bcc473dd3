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
from numpy.typing import ArrayLike
from scipy import signal

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.identification.loops import Recursion, companion_states, recursive_least_squares, shift
from tactuator.identification.prepared import (
    Prepared,
    check_length,
    empirical_response,
    require_excitation,
    usual_band,
    valid_range_of,
)
from tactuator.identification.residual_tests import check_residual
from tactuator.identification.result import Identification
from tactuator.model.plant import DERIVATIVES
from tactuator.model.plant_model import Excess, PlantModel
from tactuator.signals.systems import ContinuousSystem


def recursive(common: Prepared) -> Identification:
    """Return the paper's estimate, judged by the same tests."""
    samples, asked, record = common.samples[0], common.asked, common.records[0]
    order = asked.order or 2
    integrated = DERIVATIVES[asked.quantity]
    if integrated >= order:
        raise BadInput(f"order {order} for a {asked.quantity} by least squares", f"{integrated + 1} or more")
    estimate = identify_recursively(
        samples.command, samples.position, samples.rate_hz, poles=order, zeros=integrated, forgetting=asked.forgetting
    )
    excitation = replace(common.excitation, needed=order + 1)
    require_excitation(excitation)
    gain = common.gain
    hold: Literal["zero-order", "first-order"] = "first-order" if asked.hold == "first-order" else "zero-order"
    states = companion_states(estimate.den, samples.command, samples.rate_hz, hold=hold)
    simulated = np.asarray(states[:, : integrated + 1] @ estimate.num[::-1])
    residual = samples.position - simulated - np.mean(samples.position - simulated)
    tests = check_residual(residual, samples.command, samples.command[:, None], samples.rate_hz)
    remarks = list(common.remarks) + list(check_length(np.roots(estimate.den), 0.0, record.duration_s))
    remarks.append("least squares is biased by sensor noise: its confidence covers the noise, not the bias")
    sizes = np.append(np.full(integrated + 1, gain), np.ones(order))
    covariance = np.zeros((sizes.size + 1, sizes.size + 1))
    covariance[:-1, :-1] = estimate.covariance * np.outer(sizes, sizes)
    if not tests.uncorrelated_with_input:
        remarks.append("the residual follows the command: the band holds the record's own response as well")
    spread = float(np.linalg.norm(samples.position - samples.position.mean()))
    model = PlantModel(
        num=estimate.num * gain,
        den=estimate.den,
        delay_s=0.0,
        covariance=covariance,
        band_hz=usual_band(record),
        quantity=asked.quantity,
        command_unit=record.command_unit,
        position_unit=record.position_unit,
        method="rls",
        record=common.source(),
        excess=Excess.none() if tests.uncorrelated_with_input else _departure(common, estimate.num, estimate.den),
    )
    return Identification(
        model=replace(model, valid_hz=valid_range_of(model, samples)),
        order=order,
        excitation=excitation,
        tests=tests,
        fit_percent=100.0 * (1.0 - float(np.linalg.norm(residual)) / spread),
        friction=None,
        tried=(),
        empirical=common.own_response,
        simulated=(simulated - simulated.mean()) * common.scale[1] + float(record.position.mean()),
        measured=record.position,
        remarks=tuple(remarks),
    )


def _departure(common: Prepared, num: FloatArray, den: FloatArray) -> Excess:
    """Return how far the record's own response, with its error, is from the model, as a standard deviation: friction
    bends that response as well, to the same side.
    """
    own = common.response
    s = 2j * np.pi * own.frequency_hz
    apart = np.log(own.value * np.polyval(den, s) / np.polyval(num, s))
    size = np.abs(apart.real) + 1j * np.abs(apart.imag)
    none = Excess(own.frequency_hz, np.zeros(s.size), np.zeros(s.size))
    return none.joined(size).joined(own.relative_error * (1.0 + 1.0j))


@dataclass(frozen=True)
class RecursiveEstimate:
    """A continuous model and the way to it.

    num, den: descending powers, den monic. covariance: of (num descending, den[1:]), by least squares, hence too small
    where the residual is coloured. time_s (h,), num_history (h, m+1), den_history (h, n), variance_history in the same
    order: how the last pass converged.
    """

    num: FloatArray
    den: FloatArray
    delay_s: float
    covariance: FloatArray
    time_s: FloatArray
    num_history: FloatArray
    den_history: FloatArray
    variance_history: FloatArray
    prediction_error: float

    @property
    def model(self) -> ContinuousSystem:
        """Return the estimate as a system."""
        return ContinuousSystem.from_polynomials(self.num, self.den, self.delay_s)


def identify_recursively(
    command: ArrayLike,
    position: ArrayLike,
    rate_hz: float,
    *,
    poles: int = 2,
    zeros: int = 0,
    delay_s: float = 0.0,
    forgetting: float = 1.0,
    passes: int = 3,
    history: int = 200,
) -> RecursiveEstimate:
    """Return the recursive least squares estimate of a model of `poles` and `zeros` on command (n,) and position (n,).

    delay_s: a known dead time (whole samples). forgetting: as in `recursive_least_squares`. passes: how often E is
    replaced by the estimate before. history: rows of convergence kept. Raises BadInput for an unknown structure or a
    record of fewer than 50 samples.
    """
    u, y = np.asarray(command, dtype=np.float64), np.asarray(position, dtype=np.float64)
    if u.shape != y.shape or u.ndim != 1 or u.size < 50:
        raise BadInput(f"command {u.shape}, position {y.shape}", "one shape (n,), 50 samples or more")
    if not (0 <= zeros < poles <= 6):
        raise BadInput(f"{poles} poles and {zeros} zeros", "1 to 6 poles, fewer zeros")
    corner = _corner(u, y, rate_hz)
    filter_polynomial = np.real(np.poly(np.full(poles, -corner)))
    every = max(1, u.size // history)
    late = shift(u, round(delay_s * rate_hz))
    for _ in range(max(1, passes)):
        regressors, goal, sizes = _regression(filter_polynomial, late, y, rate_hz, zeros)
        recursion = recursive_least_squares(regressors, goal, forgetting=forgetting, every=every)
        theta = recursion.theta / sizes
        filter_polynomial = _as_filter(np.append(1.0, theta[zeros + 1 :]), corner)
    return _estimate(recursion, sizes, zeros, delay_s, every / rate_hz)


def _corner(u: FloatArray, y: FloatArray, rate_hz: float) -> float:
    """Return where the response has fallen to a tenth of its largest value, rad/s: above most poles, below
    most noise.
    """
    response = empirical_response(u, y, rate_hz)
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
    from_u = companion_states(e, u - u.mean(), rate_hz)[:, : zeros + 1][:, ::-1]
    centred = y - y.mean()
    from_y = companion_states(e, centred, rate_hz, hold="first-order")
    highest = centred - from_y @ e[:0:-1]
    columns = np.hstack([from_u, -from_y[:, ::-1]])
    # steady offsets of sensor and command are in no model: slow parts far below the filter's corner are removed alike
    columns, goal = _without_offset(columns, rate_hz), _without_offset(highest[:, None], rate_hz)[:, 0]
    # what went on before the record began dies out with E's own poles
    start = int(min(6.0 * rate_hz / np.min(np.abs(np.roots(e).real)), 0.2 * u.size))
    columns, goal = columns[start:], goal[start:]
    column_size, goal_size = np.sqrt(np.mean(columns**2, axis=0)), float(np.sqrt(np.mean(goal**2)))
    column_size[column_size == 0.0] = 1.0
    if goal_size == 0.0:
        raise BadInput("the position does not move", "a record of something that moves")
    return columns / column_size, goal / goal_size, column_size / goal_size


def _without_offset(columns: FloatArray, rate_hz: float) -> FloatArray:
    """Apply a first-order high-pass with its corner at 3 periods of the record: it takes offsets away, alike in every
    column.
    """
    corner = 3.0 * rate_hz / columns.shape[0]
    b, a = signal.butter(1, min(2.0 * corner / rate_hz, 0.5), "highpass")
    return np.asarray(signal.lfilter(b, a, columns, axis=0))


def _estimate(recursion: Recursion, sizes: FloatArray, zeros: int, delay_s: float, step_s: float) -> RecursiveEstimate:
    theta = recursion.theta / sizes
    history = recursion.theta_history / sizes
    scale = np.outer(1.0 / sizes, 1.0 / sizes) * recursion.prediction_variance
    return RecursiveEstimate(
        num=theta[: zeros + 1],
        den=np.append(1.0, theta[zeros + 1 :]),
        delay_s=delay_s,
        covariance=recursion.inverse_information * scale,
        time_s=step_s * np.arange(1, history.shape[0] + 1),
        num_history=history[:, : zeros + 1],
        den_history=history[:, zeros + 1 :],
        variance_history=recursion.variance_history * np.diag(scale),
        prediction_error=float(np.sqrt(recursion.prediction_variance)),
    )

"""The form that a record asks for: proposals by the local response, the choice by the record's own likelihood."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from types import MappingProxyType

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.data import Data
from tactuator.identification.form import (
    MANY,
    MOST_POLES,
    Form,
    Known,
    fewer_poles,
    free_poles,
    numerator_polynomial,
    sections_of,
    without_cancelled,
)
from tactuator.identification.hold import Hold
from tactuator.identification.likelihood import SpectralFit, SpectralProblem
from tactuator.identification.starts import Starter

TIE = 6.0
"""Difference of the criterion within which the form of fewer poles is taken (Raftery 1995: from 6 on it is strong)."""
_KEPT = 6
"""Forms that are fitted to the record."""
_WORTH, _WORTH_SHARE = 1e-2, 1e-8
"""What a step has to win of the cost, in itself and as a share, while forms are compared."""
_NEAR = 60.0
"""Difference of the criterion within which a form is gone on with by the last weights: it may come near enough."""
_FAR_OFF = 20.0
"""Cost of a form over the best one's from which on it will not do."""
_FITS, _HOPELESS = 1.5, 300.0
"""Mean squared departure from the local response, in its errors, of a form that follows it; the criterion's difference
from which on another hold is not tried with more poles."""
_STRETCHES, _CHANCE = (1, 2, 4, 8, 16, 32), 9.0
"""Lengths of stretches of the local response, points, and the mean power that nothing but its errors leaves in none of
them (exp(-9) is the chance of one stretch)."""
_POOR = 3.0
"""Mean squared departure from the local response, in its errors, from which on forms with many zeros are tried."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Under one hold: the fit chosen, every form that was fitted to the record with its criterion (Bayes), and the
    problem with the noise's weights. rival: a fit with growing poles that the record does not exclude."""

    hold: Hold
    fit: SpectralFit
    fits: dict[Form, SpectralFit]
    problem: SpectralProblem
    rival: SpectralFit | None = None


def propose(
    data: Data,
    holds: tuple[Hold, ...],
    known: Known,
    note: Callable[[str], None] = lambda _: None,
    near: Mapping[Hold, Sequence[SpectralFit]] = MappingProxyType({}),
) -> dict[Hold, list[SpectralFit]]:
    """Return fits to the local response under each hold, best first: poles are added until two more bring nothing.

    near: fits without the values that are known, in the same scale, to start from as well.
    """
    proposals = _Proposals(data, holds, known)
    best, stale = np.inf, 0
    for poles in [known.poles] if known.poles is not None else range(known.least_poles, MOST_POLES + 1):
        now = proposals.add_forms(poles)
        note(f"{poles} poles")
        stale = stale + 1 if now > best - TIE else 0
        best = min(best, now)
        if stale >= 2 or (np.isfinite(best) and proposals.nothing_left()):
            break
    # behind sensors of velocity or acceleration amplifiers pass nothing at rest: a zero more than the usual forms have
    if proposals.least_cost() > _POOR * data.local.frequency_hz.size or known.origin_zeros:
        late = proposals.leading()[1].form.dead_time
        for poles in [known.poles] if known.poles is not None else range(MANY, MOST_POLES + 1):
            note(f"{poles} poles and as many zeros")
            is_tried = np.isfinite(proposals.add_full_forms(poles, late))
            if is_tried and poles >= proposals.leading()[1].form.poles and proposals.nothing_left():
                break
    for hold, fits in near.items():
        for fit in fits:
            proposals.add_from_free(hold, fit)
    return {hold: [fit for _, fit in sorted(scored, key=itemgetter(0))] for hold, scored in proposals.scored.items()}


class _Proposals:
    """Fits to one local response under several holds, each with its score: -2 log likelihood and Bayes' penalty."""

    def __init__(self, data: Data, holds: tuple[Hold, ...], known: Known) -> None:
        scale = data.scale_rad_s
        self._known, self._points = known.in_scale(scale), data.local.frequency_hz.size
        self._delay = None if known.delay_s is None else known.delay_s * scale
        self._starters = {
            hold: Starter(
                data.local, data.rate_hz, hold, scale, data.late_s, may_grow=data.in_loop, skewed=data.may_be_skewed
            )
            for hold in holds
        }
        self.scored: dict[Hold, list[tuple[float, SpectralFit]]] = {hold: [] for hold in holds}

    def leading(self) -> tuple[float, SpectralFit]:
        """Return the best fit with its score."""
        return min((pair for scored in self.scored.values() for pair in scored), key=itemgetter(0))

    def least_cost(self) -> float:
        """Return the least cost of all fits."""
        return min((fit.cost for scored in self.scored.values() for _, fit in scored), default=np.inf)

    def _add(self, hold: Hold, fit: SpectralFit) -> float:
        score = 2.0 * fit.cost + float(np.log(2.0 * self._points)) * fit.form.count
        self.scored[hold].append((score, fit))
        return score

    def _fitted(self, hold: Hold, form: Form, before: dict[Form, SpectralFit]) -> float:
        """Add the fit of a form, and return its score; before: those under other holds, to start from."""
        # mean squared departure from the local response, in its errors, of the best fit at the worst
        hopeless = _FAR_OFF * min(self.least_cost(), 15.0 * self._points)
        fit = self._starters[hold].fit(form, self._delay or 0.0, before.get(form), hopeless)
        if fit is None:
            return np.inf
        before.setdefault(form, fit)
        return self._add(hold, fit)

    def add_forms(self, poles: int) -> float:
        """Add the usual forms of so many poles, and return their best score.

        A hold that is far behind one that leaves no more than the errors is left out: further poles would only imitate
        it. So are forms without dead time where one with it follows the response and the best without it is far off.
        """
        bests = {hold: min((score for score, _ in scored), default=np.inf) for hold, scored in self.scored.items()}
        leads = min(bests, key=bests.__getitem__)
        fits = _least(self.scored[leads]) <= _FITS * self._points
        now, before = np.inf, dict[Form, SpectralFit]()
        for hold in self.scored:
            if fits and not bests[hold] < bests[leads] + _HOPELESS:
                continue
            prompt, late = (_least(self.scored[hold], dead_time) for dead_time in (False, True))
            late_alone = late <= _FITS * self._points and prompt > _FAR_OFF * late
            for form in self._known.forms(poles):
                if form.dead_time or not late_alone:
                    now = min(now, self._fitted(hold, form, before))
        return now

    def add_full_forms(self, poles: int, late: bool) -> float:
        """Add the forms with many zeros, late: with a dead time, and return their best score."""
        before = dict[Form, SpectralFit]()
        scores = [
            self._fitted(hold, form, before) for hold in self.scored for form in self._known.full_forms(poles, late)
        ]
        return min(scores, default=np.inf)

    def add_from_free(self, hold: Hold, fit: SpectralFit) -> None:
        """Add the fit with the values that are known, where its form can have them."""
        for form, theta in self._known.like(fit.form, free_poles(fit.theta, fit.form)):
            delay = fit.delay if self._delay is None else self._delay
            begun = self._starters[hold].problem.descend(form, theta, delay, most=10)
            if begun is not None:
                self._add(hold, begun)

    def nothing_left(self) -> bool:
        """Return true where the best fit leaves of the local response no more than chance would, in no stretch of it:
        further poles could bring nothing.
        """
        _, best = self.leading()
        problem = self._starters[best.grid.hold].problem
        rest = problem.residual(best) * problem.weight
        sums = np.concatenate([[0.0], np.cumsum(rest)])
        return all(
            rest.size < width or float(np.max(np.abs(sums[width:] - sums[:-width]) ** 2)) <= _CHANCE * width
            for width in _STRETCHES
        )


def _least(scored: list[tuple[float, SpectralFit]], dead_time: bool | None = None) -> float:
    """Return the least cost, of forms with or without dead time alone if that is stated."""
    return min((fit.cost for _, fit in scored if dead_time in (None, fit.form.dead_time)), default=np.inf)


def choose(
    data: Data,
    proposals: list[SpectralFit],
    hold: Hold,
    known: Known,
    *,
    quick: bool = False,
    begun: Choice | None = None,
    stable: bool = False,
) -> Choice:
    """Return the form of best criterion on the data (quick: of the best two only), and those that come near it.

    begun: the quick choice, to go on from. stable: no pole may move into the right half plane.
    """
    kept = _best_few(proposals)[: 2 if quick else _KEPT]
    first, first_hz = kept[0], kept[0].grid.frequency_hz[0]
    if begun is None:
        problem = data.problem(first.grid.scale_rad_s, hold, stable=stable)
        for _ in range(2):
            problem = data.weighted(problem, first)
            first = problem.continued(first, 8)
    else:
        problem, first = begun.problem, begun.fit
    others = [  # as far as needed to separate forms: only the best are continued
        problem.descend(rival.form, rival.theta, rival.delay, most=8, gain=_WORTH, share=_WORTH_SHARE)
        for rival in kept
        if rival.form != first.form
    ]
    fits = {first.form: first} | {rival.form: rival for rival in others if rival is not None}
    best = _best(problem, fits)
    for _ in range(1 if quick else 2):
        problem = data.weighted(problem, best)
        best = problem.continued(best, 10)
    for added in _with_slow_poles(problem, best, known, float(first_hz)):
        problem = data.weighted(problem, added)
        best = problem.continued(added, 10)
    fits[best.form] = best
    if quick:
        return Choice(hold, best, {best.form: best}, problem)
    near = [fit for fit in fits.values() if problem.criterion(fit) < problem.criterion(best) + _NEAR]
    continued = {fit.form: problem.continued(fit, 4) for fit in near if fit is not best}
    return Choice(hold, best, continued | {best.form: best}, problem)


SHOWN_LATE = 10.0
"""First frequency of the local response over that of the lowest line, from which on the record may show more below: 7
where its first band shows it."""
_SLOWER, _STARTS = 12.0, 8
"""What a pole below all that the local response shows has to win of the criterion; places where one is looked for."""


def _with_slow_poles(
    problem: SpectralProblem, best: SpectralFit, known: Known, first_hz: float
) -> Iterator[SpectralFit]:
    """Yield the fit with a pole and a zero more below first_hz, and with two, as long as the record asks for them.

    Where a command's lines are as smooth as a transient, as those of a quick sweep's slow end, the local response shows
    nothing, and proposes nothing: the record by itself may show more.
    """
    price, to_scale = float(np.log(problem.given.total)), 2.0 * np.pi / best.grid.scale_rad_s
    lowest_hz = float(problem.grid.frequency_hz.min())
    places = np.geomspace(lowest_hz, first_hz, _STARTS) * to_scale
    while best.form.poles < MOST_POLES and best.form.gain is None and first_hz > SHOWN_LATE * lowest_hz:
        form = replace(best.form, poles=best.form.poles + 1, zeros=best.form.zeros + 1)
        won = problem.won_by(best, places)
        if not known.allows(form) or 2.0 * float(np.max(won)) < 2.0 * price + _SLOWER:
            break
        theta = sections_of(np.append(free_poles(best.theta, best.form), -places[np.argmax(won)]))
        slower = problem.descend(form, theta, best.delay, most=12)
        if slower is None or problem.criterion(slower) > problem.criterion(best) - _SLOWER:
            break
        best = slower
        yield best


def simplest(choice: Choice, known: Known, is_within: Callable[[SpectralFit], bool]) -> tuple[Choice, bool]:
    """Return the choice with a form of fewest parameters whose response is indistinguishable from the chosen one's:
    those that were fitted, then those that are simpler by a pole, a zero or a dead time, one after the other; or, where
    one of these leaves less than the chosen one, the choice with it, and true: the search had missed it.

    is_within: whether a fit's response lies within the band of the chosen one.
    """
    alike = [fit for fit in choice.fits.values() if is_within(fit)]
    now = min([choice.fit, *alike], key=lambda fit: (fit.form.count, fit.cost))
    simpler: SpectralFit | None = now
    while simpler is not None:
        now, least, simpler = simpler, choice.fit, None
        for form, theta in _simpler(now):
            # a zero far away and a short dead time are alike: converters are late more often than motors have the zero
            if (form.count, form.zeros) < (now.form.count, now.form.zeros) and known.allows(form):
                delay = now.delay if form.dead_time or known.delay_s is not None else 0.0
                fit = choice.problem.descend(form, theta, delay, most=12)
                if fit is not None and is_within(fit):
                    simpler = fit
                    break
                least = min(least, fit or least, key=lambda each: each.cost if np.isfinite(each.cost) else np.inf)
        if simpler is None and least is not choice.fit:
            return replace(choice, fit=least, fits={**choice.fits, least.form: least}), True
    return choice if now is choice.fit else replace(choice, fit=now, fits={**choice.fits, now.form: now}), False


def _best_few(proposals: list[SpectralFit]) -> list[SpectralFit]:
    """Return the best few, three of each number of poles at most, without those that are far off."""
    kept: list[SpectralFit] = []
    for fit in proposals:
        if fit.cost <= _FAR_OFF * proposals[0].cost and sum(other.form.poles == fit.form.poles for other in kept) < 3:
            kept.append(fit)
    return kept[:_KEPT]


def _best(problem: SpectralProblem, fits: dict[Form, SpectralFit]) -> SpectralFit:
    lowest = min(problem.criterion(fit) for fit in fits.values())
    near = [fit for fit in fits.values() if problem.criterion(fit) <= lowest + TIE]
    return min(near, key=lambda fit: (fit.form.poles, problem.criterion(fit)))


def _simpler(fit: SpectralFit) -> Iterator[tuple[Form, FloatArray]]:
    """Return the forms beside the fit's, with where to start: a far pole less (perhaps a dead time for it), a slow one
    with a zero less, the one that a zero cancels best with that zero less, a zero less, no dead time.
    """
    form = fit.form
    zeros = np.roots(numerator_polynomial(fit.stages, fit.numerator, form))
    cancelled = without_cancelled(free_poles(fit.theta, form), zeros)
    fewer = 0 if cancelled is None else form.free - cancelled.size
    if cancelled is not None and form.zeros - fewer >= form.origin_zeros and form.poles > fewer > 0:
        yield replace(form, poles=form.poles - fewer, zeros=form.zeros - fewer), sections_of(cancelled)
    without_far, without_slow = fewer_poles(free_poles(fit.theta, form))
    if without_far is not None and without_slow is not None and form.poles > 1:
        if form.zeros < form.poles:
            yield replace(form, poles=form.poles - 1), sections_of(without_far)
        if form.zeros < form.poles - 1:
            yield replace(form, poles=form.poles - 1, dead_time=True), sections_of(without_far)
        if form.zeros > form.origin_zeros:
            yield replace(form, poles=form.poles - 1, zeros=form.zeros - 1), sections_of(without_slow)
    if form.zeros > form.origin_zeros:
        yield replace(form, zeros=form.zeros - 1), fit.theta
        yield replace(form, zeros=form.zeros - 1, dead_time=True), fit.theta
    if form.dead_time:
        yield replace(form, dead_time=False), fit.theta

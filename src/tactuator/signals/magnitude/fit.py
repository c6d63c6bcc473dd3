"""Sampled filters of a given magnitude: the least possible maximum error in dB, stable and minimum phase.

On the unit circle |F|^2 is a ratio N(x)/D(x) of polynomials in x = tan^2(pi f / rate), x from 0 to infinity; any ratio
positive there is the squared magnitude of one stable, minimum-phase filter. "The error is at most e dB" is linear in
the coefficients of N and D, so that a bisection over linear programs finds the least e, globally. (Rabiner, Graham &
Helms 1974, "Linear programming design of IIR digital filters with arbitrary magnitude function", IEEE Trans. ASSP 22.)

Powers of x over six decades would be hopeless to compute with. N and D are written as partial fractions instead, 1 and
a_k/(x + a_k) with a_k even in log frequency: the same functions, and well conditioned. For goals of more than 60 dB
from end to end N gets fractions of its own, 1 and b_k/(x + b_k), such that prod(x + b_k)/prod(x + a_k) already has the
goal's rough shape; the better of both is taken.
"""

from __future__ import annotations

import numpy as np

from tactuator.errors import BadInput
from tactuator.signals.magnitude.goal import MagnitudeGoal
from tactuator.signals.magnitude.program import STEEP_DB, Program
from tactuator.signals.systems import SampledSystem

_MEANT = 1.1
"""What rounding may make of an error that a linear program keeps."""
_REFINED_ORDER, _REFINED_DB = 8, (0.22, 0.45, 0.45)


def fit_magnitude(goal: MagnitudeGoal, rate_hz: float, order: int) -> SampledSystem:
    """Return the stable, minimum-phase filter of `order` poles (and as many zeros) nearest to the goal, in maximum dB.

    The common error is within 3 % of the least possible: a little is given up for poles and zeros that keep away from
    the unit circle. Raises BadInput if no filter of that order is within 16 dB.
    """
    steep = float(np.ptp(goal.level_db)) > STEEP_DB
    failed: BadInput | None = None
    found: list[Program] = []
    for shaped in (False, True) if steep else (False,):
        try:
            found.append(Program(goal, rate_hz, order, shaped))
        except BadInput as error:
            failed = error
    if not found:
        assert failed is not None
        raise failed
    return _refined(min(found, key=_off_db)).filter()


def fit_within(goal: MagnitudeGoal, rate_hz: float, order: int, error_db: float) -> SampledSystem | None:
    """Return a filter of `order` poles whose common error is no more than `error_db`, or None if none was found: much
    quicker than to ask for the least error.
    """
    for shaped in (False, True) if float(np.ptp(goal.level_db)) > STEEP_DB else (False,):
        try:
            found = Program(goal, rate_hz, order, shaped, within_db=error_db)
        except BadInput:
            continue
        if found.excess_db == 0.0 and found.error_db <= _MEANT * error_db:
            return found.filter()
    return None


def _refined(best: Program) -> Program:
    """Solve the program again in a basis of its own solution's roots, as long as it is poor and that helps."""
    for enough_db in _REFINED_DB:
        if best.excess_db == 0.0 and (best.order < _REFINED_ORDER or best.error_db <= enough_db):
            break
        try:
            again = best.again()
        except BadInput:
            break
        if _off_db(again) >= _off_db(best):
            break
        best = again
    return best


def _off_db(program: Program) -> float:
    """Return the error of the program's filter from its goal, dB: in the band and, above it, beyond the ceiling."""
    return program.error_db + program.excess_db

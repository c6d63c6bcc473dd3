"""One loop and its responses.

r -> F -> (+) -> e -> C -> u -> P -> y        L = C P, S = 1/(1 + L), T = L/(1 + L), H = F T
           ^-                        |
           +-------------------------+
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import ComplexArray
from tactuator.loop.stability import System, UnstableLoop, is_stable


@dataclass(frozen=True)
class FeedbackLoop:
    """Unity negative feedback of `controller` and `plant`, both continuous or both sampled at one rate.

    The computing delay belongs to one of the two (`delay_samples`). Mixing kinds of time raises BadInput.
    """

    controller: System
    plant: System

    def __post_init__(self) -> None:
        _ = self.open_loop

    @cached_property
    def open_loop(self) -> System:
        """Return L = C P as one system."""
        product: System = self.controller * self.plant  # the systems refuse a mixture
        return product

    @cached_property
    def is_stable(self) -> bool:
        """Return whether the closed loop is stable."""
        return is_stable(self.open_loop)

    def require_stable(self) -> None:
        """Raise UnstableLoop unless the closed loop is stable."""
        if not self.is_stable:
            raise UnstableLoop("the closed loop is unstable: it has no margins and no steady response", "a stable one")

    def open_response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the open-loop response L at `frequency_hz` (hertz, any shape)."""
        return self.controller.response(frequency_hz) * self.plant.response(frequency_hz)

    def sensitivity(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return S = 1/(1 + L): from a disturbance of the position to the position."""
        numerator, denominator = self.open_loop.fraction(frequency_hz)
        return np.asarray(denominator / (numerator + denominator))

    def complementary(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return T = L/(1 + L): from F's output to the position, and (with a minus sign) from sensor noise to it."""
        numerator, denominator = self.open_loop.fraction(frequency_hz)
        return np.asarray(numerator / (numerator + denominator))

    def command_sensitivity(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return C S: from F's output to the command."""
        (c, c_den), (p, p_den) = self.controller.fraction(frequency_hz), self.plant.fraction(frequency_hz)
        return np.asarray(c * p_den / (c * p + c_den * p_den))

    def load_sensitivity(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return P S: from a voltage added to the command (friction, a force) to the position."""
        (c, c_den), (p, p_den) = self.controller.fraction(frequency_hz), self.plant.fraction(frequency_hz)
        return np.asarray(p * c_den / (c * p + c_den * p_den))


@dataclass(frozen=True)
class TwoDegreeLoop:
    """A prefilter ahead of a loop; without a feedback controller, ahead of the plant itself."""

    prefilter: System
    controller: System | None
    plant: System

    @cached_property
    def feedback(self) -> FeedbackLoop | None:
        """Return the loop behind the prefilter, or None."""
        return None if self.controller is None else FeedbackLoop(self.controller, self.plant)

    def position_response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return H = F T (or F P): volts of y per unit of reference."""
        loop = self.feedback
        behind = self.plant.response(frequency_hz) if loop is None else loop.complementary(frequency_hz)
        return self.prefilter.response(frequency_hz) * behind

    def command_response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return F C S (or F): volts of command per unit of reference."""
        ahead = self.prefilter.response(frequency_hz)
        return ahead if self.feedback is None else ahead * self.feedback.command_sensitivity(frequency_hz)

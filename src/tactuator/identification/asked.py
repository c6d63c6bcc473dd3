"""Things that a user knows or wishes of the model that is identified."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.errors import BadInput
from tactuator.identification.fixed.value import Fixed, contradiction
from tactuator.identification.forms.known import Known
from tactuator.identification.spectral.hold import HOLDS
from tactuator.model.plant import DERIVATIVES


@dataclass(frozen=True)
class Asked:
    """Things known or wished beforehand: order, zeros (None: chosen), integrators, delay_s (None: estimated), hold,
    quantity, whether friction is looked for, values that are known.
    """

    order: int | None = None
    zeros: int | None = None
    integrators: int = 0
    delay_s: float | None = None
    hold: str = "auto"
    quantity: str = "displacement"
    friction: bool = True
    fixed: tuple[Fixed, ...] = ()

    def __post_init__(self) -> None:
        if self.order is not None and not 1 <= self.order <= 8:
            raise BadInput(f"order {self.order}", "1 to 8")
        if self.quantity not in DERIVATIVES:
            raise BadInput(f"quantity {self.quantity!r}", f"{', '.join(DERIVATIVES)}")
        if self.hold not in ("auto", *HOLDS):
            raise BadInput(f"hold {self.hold!r}", f"auto, {', '.join(HOLDS)}")
        most = self.order if self.order is not None else 8
        if self.zeros is not None and not DERIVATIVES[self.quantity] <= self.zeros <= most:
            raise BadInput(f"{self.zeros} zeros", f"{DERIVATIVES[self.quantity]} to {most}")
        if not 0 <= self.integrators <= most:
            raise BadInput(f"{self.integrators} integrators", f"0 to {most}")
        if self.delay_s is not None and not 0.0 <= self.delay_s < np.inf:
            raise BadInput(f"a dead time of {self.delay_s:g} s", "zero or more")
        against = contradiction(self.fixed, self.order, self.zeros, self.integrators, DERIVATIVES[self.quantity])
        if against is not None:
            raise BadInput(f"{against}", "values that do not contradict each other or the form")

    def known(self, ratio: float) -> Known:
        """Return what this says of the form of responses in units of `ratio`; a velocity has a zero at s = 0."""
        pins = tuple(pin for pin in (one.pin(ratio) for one in self.fixed) if pin is not None)
        sections = tuple(one.section for one in self.fixed if one.section)
        origin_zeros = DERIVATIVES[self.quantity]
        return Known(self.order, self.zeros, self.integrators, origin_zeros, self.delay_s, sections, pins)

    @property
    def may_be_motor(self) -> bool:
        """Tell whether nothing that is asked speaks against a free motor with friction."""
        return (
            self.friction
            and self.quantity == "displacement"
            and self.order in (None, 2)
            and self.zeros in (None, 0)
            and self.integrators <= 1
            and not self.delay_s
            and not self.fixed
        )

    @property
    def is_free(self) -> bool:
        """Tell whether nothing of the form but its order is given, so that the time domain's search can serve."""
        return self.zeros is None and self.integrators == 0 and self.delay_s is None and not self.fixed

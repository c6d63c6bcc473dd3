"""A record: command and position of one mechanism, evenly sampled, with units and where they come from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.signals.multisine import without_periods


@dataclass(frozen=True, eq=False)
class Record:
    """A measured time series. command, position: (n,), finite, at rate_hz, in command_unit and position_unit.
    reference: what a loop around it was asked for, (n,), or None.

    about: what is known of its making (rig, date, channel, load, calibration). remarks: what had to be done to it
    (samples filled, stamps evened out), to be told to whoever uses it.
    """

    rate_hz: float
    command: FloatArray
    position: FloatArray
    command_unit: str = "V"
    position_unit: str = "V"
    reference: FloatArray | None = None
    about: dict[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate_hz) and self.rate_hz > 0.0):
            raise BadInput(f"record: rate is {self.rate_hz} Hz", "a positive number")
        if self.command.ndim != 1 or self.command.shape != self.position.shape:
            raise BadInput(f"record: command {self.command.shape}, position {self.position.shape}", "one shape (n,)")
        if self.reference is not None and (
            self.reference.shape != self.command.shape or not np.all(np.isfinite(self.reference))
        ):
            raise BadInput(f"record: reference {self.reference.shape}", f"numbers, {self.command.shape}")
        for name in ("command", "position"):
            bad = np.flatnonzero(~np.isfinite(getattr(self, name)))
            if bad.size:
                raise BadInput(
                    f"record: {name} is not a number in {bad.size} samples, first in sample {bad[0]}", "none"
                )

    def part(self, piece: slice) -> Record:
        """Return the samples of a piece of the record, periods of a plan no longer known."""
        reference = None if self.reference is None else self.reference[piece]
        about = without_periods(self.about)
        return replace(
            self, command=self.command[piece], position=self.position[piece], reference=reference, about=about
        )

    @property
    def duration_s(self) -> float:
        """Return the length of the record, seconds."""
        return self.command.size / self.rate_hz

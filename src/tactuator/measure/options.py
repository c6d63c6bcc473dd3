"""What a measurement may be asked: every default of measure, noise, disturb and finger, once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tactuator.errors import BadInput
from tactuator.perception.curve import check_level

MAINS_HZ = 60.0
"""Frequency of mains, hertz, as in the paper; 0: no mains."""
METHODS = ("stepped", "multisine")
LISTENED_S = 8.0
"""Seconds of rest over which hum and noise are measured."""
PROBED_GAINS = (2.0, 4.0, 8.0, 16.0, 32.0)
"""The paper's proportional controllers, volts of command per volt of y."""
REJECTION_HZ = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 50.0, 100.0)
"""Frequencies of a force, hertz: from a slow press to where a loop rejects no more."""
EXCURSION_MM = 1.0
"""What each force of a disturbance would move without the loop."""
FINGER_LEVEL_DB_SL = 24.0
"""Level of each line by which a finger's impedance is found."""
FINGER_S = 60.0
"""Seconds of that play, a little less than half of them free."""


@dataclass(frozen=True)
class MeasurementOptions:
    """What a measured response is asked for, whatever its method.

    level_db_sl: of each tone. channels: to be measured (None: all). load: name of what touches the display; the caller
    attaches it at the finger port. confidence_db: half-width at `coverage` to reach; a simultaneous statement about m
    points asks for a coverage of 1 - 0.05/m (Bonferroni). longest_s: seconds per point at most. mains_hz: 0 for none;
    what is played keeps 2 Hz off its multiples. band_hz: none is played outside (None: below 0.45 of the rate).
    """

    level_db_sl: float = 30.0
    channels: Sequence[str] | None = None
    load: str = "none"
    confidence_db: float = 0.25
    longest_s: float = 30.0
    coverage: float = 0.95
    mains_hz: float = MAINS_HZ
    band_hz: tuple[float, float] | None = None
    controller_hash: str = ""

    def __post_init__(self) -> None:
        check_level(self.level_db_sl)
        for key in ("confidence_db", "longest_s"):
            if not 0.0 < getattr(self, key) < float("inf"):
                raise BadInput(f"{getattr(self, key):g}", "above 0", key=key)
        if not 0.0 < self.coverage < 1.0:
            raise BadInput(f"{self.coverage:g}", "between 0 and 1", key="coverage")
        if not 0.0 <= self.mains_hz < float("inf"):
            raise BadInput(f"{self.mains_hz:g}", "0 (none) or more", key="mains_hz")

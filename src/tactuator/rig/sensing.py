"""Channels that a rig cannot hear: a display on a sound card may have actuators without a sensor."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol, runtime_checkable

from tactuator.errors import BadInput
from tactuator.rig.rig import Rig


@runtime_checkable
class PartlyDeaf(Protocol):
    """A rig that may have channels without a sensor."""

    @property
    def without_sensor(self) -> tuple[str, ...]:
        """Return the names of the channels that have none: `("thumb",)`."""
        ...


def require_sensors(rig: Rig, names: Iterable[str]) -> None:
    """Raise BadInput, naming the first, where one of the channels has no sensor."""
    deaf = rig.without_sensor if isinstance(rig, PartlyDeaf) else ()
    for name in names:
        if name in deaf:
            raise BadInput(
                f"channel {name!r} has no sensor, and there is nothing to measure with",
                "an input of the card ([sound] input), or `play`, which needs none",
            )

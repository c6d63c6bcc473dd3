"""Where a curve was felt, or where a display is felt: site, contactor, surround, preload, people."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from tactuator.parameters import Band, Positive, parameters, table, unit


@table("contact")
class Contact:
    """What touches the skin, and where. None and "" say that nobody stated it.

    A threshold, and an equal-strength contour, hold for the contact they were measured at: a small contactor, one
    without a surround, another site or an older person feels another one.
    """

    site: Annotated[str, Field(description='where the skin is touched, as "index fingertip" or "thenar"')] = ""
    area_mm2: Annotated[Positive | None, Field(description="of the contactor that moves")] = None
    surround: Annotated[
        str, Field(description='what stands still around the contactor, as "rigid, gap 1 mm" or "none"')
    ] = ""
    preload_n: Annotated[Positive | None, Field(description="the force that presses skin and contactor together")] = (
        None
    )
    age_years: Annotated[Band | None, Field(description="of the people, the youngest and the oldest")] = None

    @property
    def said(self) -> dict[str, str]:
        """Return what is stated, by key, as a person reads it: with units."""
        stated = {key: getattr(self, key) for key in parameters(Contact) if getattr(self, key) not in (None, "")}
        return {key: _words(key, value) for key, value in stated.items()}

    def differences(self, other: Contact) -> Iterator[tuple[str, str, str]]:
        """Yield key, this one's words and the other's, where both state it and they differ.

        Sites are the same where one's words are among the other's: "fingertip" and "index fingertip". Areas and forces
        are within a factor of 1.5, ages where they overlap.
        """
        for key in self.said.keys() & other.said.keys():
            if not _alike(getattr(self, key), getattr(other, key)):
                yield key, self.said[key], other.said[key]


_FACTOR = 1.5


def _alike(mine: object, theirs: object) -> bool:
    if isinstance(mine, float) and isinstance(theirs, float):
        return 1.0 / _FACTOR <= mine / theirs <= _FACTOR
    if isinstance(mine, tuple) and isinstance(theirs, tuple):
        return bool(mine[0] <= theirs[1] and theirs[0] <= mine[1])
    words = [set(str(each).lower().replace(",", " ").split()) for each in (mine, theirs)]
    return words[0] <= words[1] or words[1] <= words[0]


def _words(key: str, value: object) -> str:
    if isinstance(value, tuple):
        return f"{value[0]:g} to {value[1]:g} {unit(key)}"
    return f"{value:g} {unit(key)}" if isinstance(value, float) else str(value)

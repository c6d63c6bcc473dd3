"""The part that every protocol file has, whatever is asked: the study, its circumstances, its subjects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from tactuator.experiment.keys import Part, Positive

Seconds = Annotated[float, Field(ge=0.0, le=86400.0, allow_inf_nan=False)]
Celsius = Annotated[float, Field(gt=0.0, lt=50.0)]
Group = Literal["hearing", "hearing-impaired", "simulated", "unknown"]
Code = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9]{1,32}$")]
ParticipantId = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9._-]{1,64}$")]
_NAME_PATTERN = r"^[a-z][a-z0-9_]{0,31}$"
_SEED_MAX = 2**53


class StudyPart(Part):
    """The table [study]: who asks, and what subjects are told.

    visits: number of visits of each subject. language: of every page, one that is shipped, or language_file: the path
    of another beside the protocol.
    """

    name: str = Field(min_length=1, max_length=200)
    seed: int = Field(ge=0, le=_SEED_MAX)
    experimenter: str = ""
    consent: str = ""
    consent_version: str = ""
    instructions: str = ""
    language: str = "en"
    language_file: str | None = None
    visits: int = Field(default=1, ge=1, le=100)


class Circumstances(Part):
    """Circumstances that psychophysics reports with a threshold; they go into columns of every session."""

    site: str = "fingertip"
    contact_area_mm2: Positive | None = None
    surround: str = "none"
    skin_temperature_c: Celsius | None = None
    preload_n: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = None
    masking_sound: Literal["none", "white", "pink"] = "none"
    masking_level_db_spl: Annotated[float, Field(allow_inf_nan=False)] | None = None


class Demographic(Part):
    """A fact that the laboratory notes of every subject: a number within limits, one of choices, or words."""

    name: str = Field(pattern=_NAME_PATTERN)
    label: str = Field(min_length=1, max_length=100)
    kind: Literal["number", "choice", "text"] = "text"
    unit: str = ""
    low: Annotated[float, Field(allow_inf_nan=False)] | None = None
    high: Annotated[float, Field(allow_inf_nan=False)] | None = None
    choices: tuple[str, ...] = ()
    required: bool = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.kind == "choice") != bool(self.choices):
            raise ValueError(
                f"demographic {self.name}: choices for a {self.kind}; allowed: with a choice, and only there"
            )
        if self.kind != "number" and (self.low is not None or self.high is not None):
            raise ValueError(f"demographic {self.name}: limits for a {self.kind}; allowed: with a number only")
        return self

    def take(self, value: str | float) -> str:
        """Return the value as it is stored. Raises ValueError, naming what is allowed, for a value that is not."""
        text = f"{value:.15g}" if isinstance(value, float) else str(value).strip()
        if self.kind == "choice" and text not in self.choices:
            raise ValueError(f"{self.name} is {text!r}; allowed: {', '.join(self.choices)}")
        if self.kind == "text" and len(text) > 200:
            raise ValueError(f"{self.name} has {len(text)} characters; allowed: 200 at most")
        if self.kind == "number":
            low, high = (-1e12 if self.low is None else self.low), (1e12 if self.high is None else self.high)
            try:
                number = float(text)
            except ValueError:
                number = float("nan")
            if not low <= number <= high:
                raise ValueError(f"{self.name} is {text!r}; allowed: a number from {low:g} to {high:g}")
        return text


class SubjectPart(Part):
    """A subject, whose own circumstances win over the study's; participant_id: their name elsewhere."""

    code: Code
    group: Group = "unknown"
    participant_id: ParticipantId | None = None
    skin_temperature_c: Celsius | None = None
    demographics: dict[str, str | float] = Field(default_factory=dict)


class StudyProtocol(Part):
    """The part of a protocol file that is the same for every kind of study."""

    study: StudyPart
    subject: tuple[SubjectPart, ...] = ()
    circumstances: Circumstances = Circumstances()
    demographic: tuple[Demographic, ...] = ()

    @model_validator(mode="after")
    def _everyone_once(self) -> Self:
        each_once("subject codes", [one.code for one in self.subject])
        each_once("participant ids", [one.participant_id for one in self.subject if one.participant_id is not None])
        each_once("demographic names", [one.name for one in self.demographic])
        for one in self.subject:
            self.facts(one.demographics)
        return self

    def facts(self, given: dict[str, str | float]) -> dict[str, tuple[str, str]]:
        """Return (value, unit) of each demographic item that is given, by name.

        Raises ValueError for an item that is not asked for, a value that is not allowed, or one that is required and
        not given.
        """
        values = {name: self.fact(name, value) for name, value in given.items()}
        for one in self.demographic:
            if one.required and given and one.name not in values:
                self.fact(one.name, "")
        return {name: (value, unit) for name, (value, unit) in values.items() if value is not None}

    def fact(self, name: str, value: str | float) -> tuple[str | None, str]:
        """Return value and unit of a demographic item as they are stored, None for "".

        Raises ValueError for an item that is not asked for, a value that is not allowed, or "" where one is required.
        """
        asked = {one.name: one for one in self.demographic}
        if name not in asked:
            raise ValueError(f"demographics: {name!r}; allowed: {', '.join(asked) or 'none: the study asks for none'}")
        if value == "" and asked[name].required:
            raise ValueError(f"demographics: {name} is not given; allowed: with it, since the study requires it")
        return None if value == "" else asked[name].take(value), asked[name].unit

    def apart_from_subjects(self) -> StudyProtocol:
        """Return the protocol without subjects, which an amendment that only enrols leaves as it was."""
        return self.model_copy(update={"subject": ()})


def each_once(what: str, values: Sequence[str]) -> None:
    """Raise ValueError where one of the values stands twice."""
    if len(set(values)) != len(values):
        raise ValueError(f"{what} {', '.join(values)}; allowed: each once")

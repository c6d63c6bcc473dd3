"""What a study does: the protocol file, validated key by key."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from tactuator.experiment.procedure.curve_prior import CurvePrior
from tactuator.experiment.procedure.fixed import Fixed
from tactuator.experiment.procedure.procedure import Procedure
from tactuator.experiment.procedure.quest_plus import QuestPlus, QuestPlusRule
from tactuator.experiment.procedure.up_down import IMECE2004, UpDown, UpDownRule
from tactuator.experiment.procedure.whole_curve import WholeCurve, WholeCurveRule
from tactuator.experiment.trial.stimulus import Masker
from tactuator.experiment.trial.timing import Timing
from tactuator.experiment.trial.trial import ForcedChoice
from tactuator.perception.levels import COMFORT_DB_SL

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Level = Annotated[float, Field(ge=-60.0, le=COMFORT_DB_SL, allow_inf_nan=False)]


class Part(BaseModel):
    """A table of the protocol file: no key but the known ones."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Study(Part):
    """Who asks, and what subjects are told."""

    name: str = Field(min_length=1)
    seed: int = Field(ge=0)
    experimenter: str = ""
    consent: str = ""
    instructions: str = ""


class ImeceProcedure(Part):
    """The paper's procedure, exactly."""

    kind: Literal["imece2004"]
    start_db_sl: Level = 20.0

    def build(self, paradigm: ForcedChoice, band_hz: tuple[float, float]) -> Procedure:
        """A fresh run."""
        return UpDown(IMECE2004, self.start_db_sl)


class UpDownProcedure(Part):
    """Any transformed up-down track; the keys are those of UpDownRule."""

    kind: Literal["up-down"]
    start_db_sl: Level = 20.0
    down: int = 3
    up: int = 1
    steps_db: tuple[float, ...] = (4.0, 4.0, 4.0, 1.0)
    reversals: int = 15
    averaged: int = 12
    initial_rule: bool = False
    average: Literal["reversals", "mid-runs"] = "reversals"
    floor_db_sl: Level = -60.0
    ceiling_db_sl: Level = COMFORT_DB_SL
    trial_limit: int = 1000

    def build(self, paradigm: ForcedChoice, band_hz: tuple[float, float]) -> Procedure:
        """A fresh run."""
        return UpDown(UpDownRule(**self.model_dump(exclude={"kind", "start_db_sl"})), self.start_db_sl)


class QuestPlusProcedure(Part):
    """QUEST+; the keys are those of QuestPlusRule."""

    kind: Literal["quest-plus"]
    trials: int = 48
    low_db_sl: Level = -30.0
    high_db_sl: Level = 40.0
    expected_db_sl: float = 0.0
    expected_sd_db: Positive = 15.0
    aim: Literal["threshold", "parameters"] = "threshold"

    def build(self, paradigm: ForcedChoice, band_hz: tuple[float, float]) -> Procedure:
        """A fresh run."""
        return QuestPlus(QuestPlusRule(**self.model_dump(exclude={"kind"}), guess=paradigm.guess))


class CurveProcedure(Part):
    """The whole curve in one run; frequencies are the procedure's own."""

    kind: Literal["curve"]
    trials: int = 150
    points: int = 20

    def build(self, paradigm: ForcedChoice, band_hz: tuple[float, float]) -> Procedure:
        """A fresh run over the display's band."""
        return WholeCurve(WholeCurveRule(self.trials, CurvePrior(band_hz, points=self.points)))


AnyProcedure = Annotated[
    ImeceProcedure | UpDownProcedure | QuestPlusProcedure | CurveProcedure, Field(discriminator="kind")
]


class Conditions(Part):
    """Runs of every subject: each frequency on each finger, repeats times, in an order of the subject's own."""

    fingers: tuple[str, ...] = Field(min_length=1)
    frequencies_hz: tuple[Positive, ...] = ()
    order: Literal["as-given", "random", "latin-square"] = "random"
    repeats: int = Field(default=1, ge=1)


class Circumstances(Part):
    """What psychophysics reports with a threshold; they go into columns of every session."""

    site: str = "fingertip"
    contact_area_mm2: Positive | None = None
    surround: str = "none"
    skin_temperature_c: Annotated[float, Field(gt=0.0, lt=50.0)] | None = None
    preload_n: Annotated[float, Field(ge=0.0)] | None = None
    masking_sound: Literal["none", "white", "pink"] = "none"
    masking_level_db_spl: float | None = None


class SessionRules(Part):
    """How a session goes: practice before the first run, breaks, feedback, and how long an interruption may last."""

    practice_trials: int = Field(default=3, ge=0, le=100)
    practice_level_db_sl: Level = 30.0
    break_after_trials: int = Field(default=100, ge=1)
    break_s: float = Field(default=0.0, ge=0.0)
    feedback: bool = True
    resume_within_s: Positive = 1800.0


class TimingPart(Part):
    """See Timing."""

    stimulus_s: float = 0.5
    ramp_s: float = 0.1
    gap_s: float = 0.3
    lead_s: float = 0.3
    periods: float = 2.0
    feedback_s: float = 0.4

    def build(self) -> Timing:
        """The timing."""
        return Timing(**self.model_dump())


class MaskerPart(Part):
    """See Masker."""

    kind: Literal["tone", "noise"]
    frequency_hz: Positive
    level_db_sl: Level
    channel: str | None = None

    def build(self) -> Masker:
        """The masker."""
        return Masker(**self.model_dump())


class Paradigm(Part):
    """Detection in one of m intervals."""

    intervals: int = Field(default=3, ge=2, le=9)


class SubjectPart(Part):
    """Someone who takes part; circumstances of one's own win over the study's."""

    code: str = Field(pattern=r"^[A-Za-z0-9]{1,32}$")
    group: Literal["hearing", "hearing-impaired", "simulated", "unknown"] = "unknown"
    skin_temperature_c: Annotated[float, Field(gt=0.0, lt=50.0)] | None = None


class StudyProtocol(Part):
    """What every protocol file has, whatever is asked."""

    study: Study
    subject: tuple[SubjectPart, ...] = Field(min_length=1)
    circumstances: Circumstances = Circumstances()

    @model_validator(mode="after")
    def _everyone_once(self) -> Self:
        each_once("subject codes", [one.code for one in self.subject])
        return self


def each_once(what: str, values: Sequence[str]) -> None:
    """Raise ValueError where one of the values stands twice."""
    if len(set(values)) != len(values):
        raise ValueError(f"{what} {', '.join(values)}; allowed: each once")


class Protocol(StudyProtocol):
    """The file of a detection study."""

    procedure: AnyProcedure
    conditions: Conditions
    paradigm: Paradigm = Paradigm()
    session: SessionRules = SessionRules()
    timing: TimingPart = TimingPart()
    masker: MaskerPart | None = None

    @model_validator(mode="after")
    def _check(self) -> Protocol:
        listed = self.conditions.frequencies_hz
        if len(set(listed)) != len(listed) or len(set(self.conditions.fingers)) != len(self.conditions.fingers):
            raise ValueError("conditions: a frequency or finger stands twice; allowed: each once")
        chooses = self.procedure.kind == "curve"
        if chooses == bool(listed):
            wanted = "none: the procedure chooses" if chooses else "one or more"
            raise ValueError(
                f"conditions.frequencies_hz has {len(listed)} for {self.procedure.kind}; allowed: {wanted}"
            )
        self.timing.build()
        self.forced_choice()
        self.procedure.build(self.forced_choice(), (0.4, 300.0))
        return self

    def forced_choice(self) -> ForcedChoice:
        """The paradigm."""
        return ForcedChoice(self.paradigm.intervals)

    def practice(self, frequency_hz: float) -> Fixed:
        """The practice run."""
        return Fixed(self.session.practice_level_db_sl, self.session.practice_trials, frequency_hz)

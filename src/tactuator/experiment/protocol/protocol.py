"""Protocol files of detection studies, validated key by key."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from tactuator.experiment.keys import Part, Positive
from tactuator.experiment.procedure.kinds import AnyProcedure, Level
from tactuator.experiment.procedure.procedure import Playable, Practice, Procedure
from tactuator.experiment.protocol.study import Seconds, StudyProtocol
from tactuator.experiment.trial.trial import ForcedChoice, Marks, Masker, Timing


class Conditions(Part):
    """Conditions of every subject: each frequency on each finger, repeats times, in an order of the subject's own."""

    fingers: tuple[str, ...] = Field(min_length=1)
    frequencies_hz: tuple[Positive, ...] = ()
    order: Literal["as-given", "random", "latin-square"] = "random"
    repeats: int = Field(default=1, ge=1)


class SessionRules(Part):
    """Rules of a session: practice before the first run, breaks, feedback, and the longest interruption of a run.

    practice_correct: number of right answers among the last practice_trials that ends practice (None: it ends after
    practice_trials). Where practice_limit trials do not reach it, the experimenter is called and practice begins again.
    break_s: the least duration of a break, by the server's clock.
    """

    practice_trials: int = Field(default=3, ge=0, le=100)
    practice_correct: int | None = Field(default=None, ge=1, le=100)
    practice_limit: int = Field(default=40, ge=1, le=1000)
    practice_level_db_sl: Level = 30.0
    break_after_trials: int = Field(default=100, ge=1, le=100000)
    break_between_runs: bool = False
    break_s: Seconds = 0.0
    feedback: bool = True
    resume_within_s: Seconds = Field(default=1800.0, gt=0.0)

    @model_validator(mode="after")
    def _criterion_can_be_met(self) -> SessionRules:
        correct, window, limit = self.practice_correct, self.practice_trials, self.practice_limit
        if correct is not None and not correct <= window <= limit:
            raise ValueError(
                f"practice: {correct} right of the last {window}, {limit} trials at most; allowed: practice_correct up "
                "to practice_trials, and that up to practice_limit"
            )
        return self


class TimingPart(Part):
    """The table [timing]; its keys are those of Timing."""

    stimulus_s: Seconds = 0.5
    ramp_s: Seconds = 0.1
    gap_s: Seconds = 0.3
    lead_s: Seconds = 0.3
    periods: Positive = 2.0
    feedback_s: Seconds = 0.4

    def build(self) -> Timing:
        """Return the timing that the table describes."""
        return Timing(**self.model_dump())


class MaskerPart(Part):
    """The table [masker]; its keys are those of Masker."""

    kind: Literal["tone", "noise"]
    frequency_hz: Positive
    level_db_sl: Level
    channel: str | None = None

    def build(self) -> Masker:
        """Return the masker that the table describes."""
        return Masker(**self.model_dump())


class MarksPart(Part):
    """The table [marks]: taps that announce intervals to subjects who neither see nor hear; its keys are those of
    Marks.
    """

    channel: str
    frequency_hz: Positive = 60.0
    level_db_sl: Level = 25.0
    tap_s: Positive = 0.08
    pause_s: Seconds = 0.12
    after_s: Seconds = 0.5

    def build(self) -> Marks:
        """Return the marks that the table describes."""
        return Marks(**self.model_dump())


class CatchTrials(Part):
    """Trials that a run has besides its procedure's: loud ones that test attention, blank ones that test for cues.

    loud_share, blank_share: shares of all trials. above_db: level of a loud trial above the procedure's next level.
    """

    loud_share: Annotated[float, Field(ge=0.0, le=0.5)] = 0.0
    blank_share: Annotated[float, Field(ge=0.0, le=0.3)] = 0.0
    above_db: Annotated[float, Field(ge=10.0, le=40.0)] = 20.0


class Paradigm(Part):
    """The table [paradigm]: detection in one of m intervals."""

    intervals: int = Field(default=3, ge=2, le=9)


class Protocol(StudyProtocol):
    """The protocol file of a detection study."""

    procedure: AnyProcedure
    conditions: Conditions
    paradigm: Paradigm = Paradigm()
    catch: CatchTrials = CatchTrials()
    session: SessionRules = SessionRules()
    timing: TimingPart = TimingPart()
    masker: MaskerPart | None = None
    marks: MarksPart | None = None

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
        if self.marks is not None:
            self.marks.build()
        self.fresh_run(Playable())
        return self

    def forced_choice(self) -> ForcedChoice:
        """Return the paradigm that the table describes."""
        return ForcedChoice(self.paradigm.intervals)

    def fresh_run(self, playable: Playable) -> Procedure:
        """Return a fresh run of the procedure, over what can be played."""
        return self.procedure.build(self.forced_choice().guess, playable)

    def practice(self, frequency_hz: float) -> Practice:
        """Return a fresh practice run at that frequency."""
        rules = self.session
        limit = rules.practice_trials if rules.practice_correct is None else rules.practice_limit
        return Practice(rules.practice_level_db_sl, limit, frequency_hz, rules.practice_trials, rules.practice_correct)

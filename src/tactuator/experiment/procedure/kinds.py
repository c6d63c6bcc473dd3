"""Kinds of procedure: the table [procedure] of a protocol file says which one places the trials, with its keys.

Each kind builds a fresh run; `guess` is the share of right answers of somebody who feels nothing.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from tactuator.experiment.keys import Part, Positive
from tactuator.experiment.procedure.curve_prior import CurvePrior
from tactuator.experiment.procedure.procedure import Answering, Playable, Procedure
from tactuator.experiment.procedure.quest_plus import QuestPlus, QuestPlusRule
from tactuator.experiment.procedure.up_down import IMECE2004, UpDown, UpDownRule
from tactuator.experiment.procedure.whole_curve import WholeCurve, WholeCurveRule
from tactuator.perception.curve import COMFORT_DB_SL, LOWEST_DB_SL

Level = Annotated[float, Field(ge=LOWEST_DB_SL, le=COMFORT_DB_SL, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]


class ImeceProcedure(Part):
    """The procedure of the paper, with nothing but its start to choose."""

    kind: Literal["imece2004"]
    start_db_sl: Level = 20.0

    def build(self, guess: float, playable: Playable) -> Procedure:
        """Return a fresh run of the procedure."""
        return UpDown(IMECE2004, self.start_db_sl)


class UpDownProcedure(Part):
    """Any transformed up-down track; the keys are those of UpDownRule."""

    kind: Literal["up-down"]
    start_db_sl: Level = 20.0
    down: int = UpDownRule.down
    up: int = UpDownRule.up
    steps_db: tuple[float, ...] = UpDownRule.steps_db
    reversals: int = UpDownRule.reversals
    averaged: int = UpDownRule.averaged
    initial_rule: bool = UpDownRule.initial_rule
    average: Literal["reversals", "mid-runs"] = UpDownRule.average
    floor_db_sl: Level = UpDownRule.floor_db_sl
    ceiling_db_sl: Level = UpDownRule.ceiling_db_sl
    trial_limit: int = UpDownRule.trial_limit

    def build(self, guess: float, playable: Playable) -> Procedure:
        """Return a fresh run of the procedure."""
        return UpDown(UpDownRule(**self.model_dump(exclude={"kind", "start_db_sl"})), self.start_db_sl)


class QuestPlusProcedure(Part):
    """The QUEST+ procedure; its keys are those of QuestPlusRule."""

    kind: Literal["quest-plus"]
    trials: int = 48
    low_db_sl: Level = -30.0
    high_db_sl: Level = 40.0
    expected_db_sl: float = 0.0
    expected_sd_db: Positive = 15.0
    aim: Literal["threshold", "parameters"] = "threshold"

    def build(self, guess: float, playable: Playable) -> Procedure:
        """Return a fresh run of the procedure."""
        return QuestPlus(QuestPlusRule(**self.model_dump(exclude={"kind"}), guess=guess))


class PriorPart(Part):
    """Prior of a curve before the first trial; the keys are those of CurvePrior."""

    normal_share: Share = 0.42
    normal_offset_db: Positive = 4.0
    normal_tilt_db_per_decade: Positive = 2.5
    normal_wave_db: Positive = 2.0
    broad_share: Share = 0.12
    broad_mean_db: float = 8.0
    broad_offset_db: Positive = 15.0
    uneven_share: Share = 0.20
    uneven_db: Positive = 7.0
    steps_share: Share = 0.14
    steps_db: Positive = 10.0
    notch_share: Share = 0.10
    notch_db: Positive = 12.0
    edge_share: Share = 0.06
    edge_db: Positive = 15.0


class CurveProcedure(Part):
    """The procedure that measures the whole curve in one run and chooses the frequencies itself."""

    kind: Literal["curve"]
    trials: int = 150
    points: int = Field(default=28, le=60)
    floor_db_sl: Level = -30.0
    ceiling_db_sl: Level = 50.0
    prior: PriorPart = PriorPart()

    def build(self, guess: float, playable: Playable) -> Procedure:
        """Return a fresh run over the display's band."""
        return WholeCurve(self.rule(guess, playable))

    def rule(self, guess: float, playable: Playable) -> WholeCurveRule:
        """Return the rule of a run over the display's band."""
        own = self.prior.model_dump()
        prior = CurvePrior(playable.band_hz, self.points, playable.mains_hz, playable.clearance_hz, **own)
        answering = Answering(guess=guess)
        return WholeCurveRule(self.trials, prior, answering, self.floor_db_sl, self.ceiling_db_sl)


AnyProcedure = Annotated[
    ImeceProcedure | UpDownProcedure | QuestPlusProcedure | CurveProcedure, Field(discriminator="kind")
]

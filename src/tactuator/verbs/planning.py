"""The part of the verb `experiment` that plans a study: plan."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tactuator.errors import BadInput
from tactuator.table import Chart, ChartLine, ResultTable
from tactuator.verbs.parameters import Fields, Figures, Option, Place, Seed
from tactuator.verbs.result import Result, finite, working

if TYPE_CHECKING:
    from tactuator.experiment.simulated.planning import PlannedStudy, StudyPlan

_STUDY = Fields("experiment.simulated.planning:PlannedStudy")
_RUNS, _CURVES = 400, 12
_SLOPES, _LAPSE = (1.5, 4.0), 0.02


@dataclass(frozen=True, eq=False, repr=False)
class PlanResult(Result):
    """What a study takes. sources: where the spread, the error and the power come from, a sentence each."""

    study: "PlannedStudy"
    plan: "StudyPlan"
    procedure: str
    sources: tuple[str, ...]

    def headline(self) -> Mapping[str, str]:
        plan, study = self.plan, self.study
        groups = " in each of two groups" if study.design == "between" else ""
        return {
            "subjects": f"{plan.subjects}{groups}",
            "trials of a person": f"{plan.trials} in {plan.minutes:.0f} min",
            "runs of each condition": str(plan.repeats),
            "error of a person's threshold": f"{plan.error_db:.2f} dB (simulated)",
            "power": f"{plan.power:.3f} for {study.effect_db:g} dB",
        }

    def columns(self) -> Mapping[str, Any]:
        subjects, power = zip(*self.plan.curve, strict=True)
        return {"subjects": list(subjects), "power": list(power)}

    def chart(self) -> Chart:
        import numpy as np

        subjects, power = (np.array(column, dtype=float) for column in self.columns().values())
        each = "subjects in each group" if self.study.design == "between" else "subjects"
        line = ChartLine(f"{self.study.effect_db:g} dB, {self.study.design}", subjects, power)
        y_label = "power (error of a run: simulated)"
        return Chart(each, y_label, [line], limits={"asked": self.study.power}, upright={"needed": self.plan.subjects})

    def to_dict(self) -> dict[str, Any]:
        plan = finite(self.plan)
        assert isinstance(plan, dict)
        return {**plan, "study": finite(self.study), "procedure": self.procedure, "sources": list(self.sources)}

    def tables(self) -> Sequence[ResultTable | str]:
        return [
            ResultTable(f"study with {self.procedure}", ("what", "value"), tuple(self.headline().items()), self.sources)
        ]


def plan(
    effect_db: Annotated[float, _STUDY.option("effect_db")],
    spread_db: Annotated[float | None, Option("Standard deviation between people, or (within) occasions, dB.")] = None,
    pilot: Annotated[
        Place | None, Option("Store of which the spread is taken, in place of --spread-db.", file=True)
    ] = None,
    procedure: Annotated[str, Option("imece2004, up-down, quest-plus, curve, or another package's.")] = "quest-plus",
    trials: Annotated[int | None, Option("Trials of a run, where the procedure has a number of them.")] = None,
    design: Annotated[str, _STUDY.option("design")] = _STUDY.default("design"),
    minutes: Annotated[float, _STUDY.option("minutes")] = _STUDY.default("minutes"),
    trial_s: Annotated[float, _STUDY.option("trial_s")] = _STUDY.default("trial_s"),
    conditions: Annotated[int, _STUDY.option("conditions")] = _STUDY.default("conditions"),
    loud_share: Annotated[float, Option("Share of loud catch trials, which take time as well.", ge=0, le=0.5)] = 0.2,
    alpha: Annotated[float, _STUDY.option("alpha")] = _STUDY.default("alpha"),
    comparisons: Annotated[int, _STUDY.option("comparisons")] = _STUDY.default("comparisons"),
    power: Annotated[float, _STUDY.option("power")] = _STUDY.default("power"),
    figures: Figures = None,
    seed: Seed = 0,
) -> PlanResult:
    """Say how many subjects and trials a study takes. The error of a run is simulated; the spread is yours to give.

    Raises BadInput where there is no spread, or the time of a person does not hold a run of every condition.
    """
    from tactuator.experiment.simulated.planning import PlannedStudy, plan_study
    from tactuator.experiment.simulated.quality import CurveQuality, Setting, simulate_kind

    if (spread_db is None) == (pilot is None):
        got = "neither --spread-db nor --pilot" if pilot is None else "--spread-db and --pilot"
        raise BadInput(got, "one of them: no spread is assumed")
    spread, source = (spread_db, "as given") if pilot is None else _spread_of(Path(pilot))
    study = PlannedStudy(effect_db, spread, design, minutes, trial_s, conditions, alpha, comparisons, power)  # type: ignore[arg-type]
    runs = _CURVES if procedure == "curve" else _RUNS
    with working(f"{runs} runs", 1.0) as step:
        quality = simulate_kind(procedure, Setting(runs, _SLOPES, _LAPSE, seed=seed), trials, None, step)
    is_curve = isinstance(quality, CurveQuality)
    error_db = quality.rms_error_db if isinstance(quality, CurveQuality) else quality.refit.rmse_db
    of_run = quality.trials if isinstance(quality, CurveQuality) else quality.trials_mean
    sources = (
        f"spread {study.spread_db:.2f} dB: {source}",
        f"error of a run {error_db:.2f} dB: rms of {runs} simulated runs (slopes {_SLOPES[0]:g} to {_SLOPES[1]:g}, "
        f"lapse rate {_LAPSE:g})",
        "power: noncentral t, both sides; people and errors taken for normal",
    )
    result = PlanResult(study, plan_study(study, error_db, of_run / (1.0 - loud_share), is_curve), procedure, sources)
    if figures is not None:
        from tactuator.report.chart import chart_plate

        chart_plate(result.chart(), "plan").save(Path(figures))
    return result


def _spread_of(store: Path) -> tuple[float, str]:
    from tactuator.experiment.result.store_results import store_results
    from tactuator.experiment.simulated.planning import measured_spread

    thresholds = store_results(store).thresholds
    spread_db, people = measured_spread(thresholds)
    simulated = "simulated " if any(each.simulated for each in thresholds) else ""
    return spread_db, f"of {people} {simulated}people in {store.name}, errors of their thresholds taken out"

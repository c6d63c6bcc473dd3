"""A procedure and a task of another package: in a protocol, a session, simulated, exported, in results and figures."""

import dataclasses
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import func, select

from tactuator.api.strength import contours, judged
from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.experiment.export import export
from tactuator.experiment.procedure.procedure import GROUP, Playable
from tactuator.experiment.protocol.file import Protocol, parse_protocol
from tactuator.experiment.protocol.study import StudyProtocol
from tactuator.experiment.result.thresholds import thresholds
from tactuator.experiment.session.studies import task_of
from tactuator.experiment.session.task import SystemClock
from tactuator.experiment.simulated.quality import Setting, simulate_kind
from tactuator.experiment.simulated.subjects import run_study, simulated_observers
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import opened_store
from tactuator.experiment.store.stored_runs import detection_runs
from tactuator.perception.curve import curve
from tests.experiment.session.apparatuses import PROTOCOL, apparatus, rows_of

SOURCE = '''
from typing import Annotated

import numpy as np
from pydantic import Field

from tactuator.experiment.procedure.procedure import Estimate, Procedure, Runs
from tactuator.parameters import Positive, Whole, table


@table("[procedure]")
class Weighted(Procedure):
    """Falls by a step after every right answer, rises by three after a wrong one; the mean of the second half."""

    trials: Annotated[Whole, Field(ge=2, description="trials of a run")] = 60
    step_db: Annotated[Positive, Field(description="step of the level")] = 1.0
    start_db_sl: float = 20.0

    def begin(self, guess=None, playable=None, count=1):
        return WeightedRuns(self, count)


class WeightedRuns(Runs):
    def __init__(self, rule, count):
        super().__init__(count, rule.trials)
        self.rule, self.levels = rule, [np.full(count, rule.start_db_sl)]

    @property
    def level_db_sl(self):
        return self.levels[-1]

    def learn(self, correct):
        self.levels.append(self.levels[-1] + np.where(correct, -self.rule.step_db, 3.0 * self.rule.step_db))

    def estimate(self, run=0):
        late = [level[run] for level in self.levels[self.rule.trials // 2 : -1]]
        return Estimate(sum(late) / len(late), None) if self.over[run] else None
'''


@pytest.fixture(autouse=True)
def foreign(install):
    install(GROUP, "weighted", SOURCE, "Weighted")


def protocol_text(keys: str) -> str:
    start, end = PROTOCOL.index("[procedure]"), PROTOCOL.index("[conditions]")
    return PROTOCOL[:start] + f'[procedure]\nkind = "weighted"\n{keys}\n' + PROTOCOL[end:]


def test_foreign_procedure__in_a_protocol_file__runs_a_whole_study(store) -> None:
    text = protocol_text("trials = 24\nstep_db = 2.0").replace("[30, 90, 210]", "[30]")
    with pytest.raises(BadInput, match="procedure: step_db is 0; it must be a number, above 0"):
        parse_protocol(protocol_text("step_db = 0"), Protocol)
    with pytest.raises(BadInput, match=r"reversals is not a known key; it must be one of kind, trials, step_db"):
        parse_protocol(protocol_text("reversals = 4"), Protocol)
    protocol = parse_protocol(text, Protocol)
    assert protocol.begin(Playable()).placement().level_db_sl == 20.0
    assert protocol.procedure.typical_trials == 24
    observers = simulated_observers(curve("bolanowski-1988"), len(protocol.subject), seed=5)
    run_study(store, protocol, text, apparatus(), observers, SystemClock(), "finger")
    found = thresholds(detection_runs(store))
    assert [(each.procedure, each.trials) for each in found] == [("weighted", 24)] * len(observers)
    assert all(each.own_db_sl is not None for each in found)


@pytest.mark.parametrize(("method", "line"), [("learn", "self.levels.append"), ("estimate", "late = ")])
def test_foreign_procedure__that_raises__is_named_with_file_and_line_and_loses_no_answer(
    store, tmp_path, capsys, monkeypatch, method, line
) -> None:
    source = SOURCE.replace(f"        {line}", f"        None.of_{method}\n        {line}")
    (tmp_path / "foreign_laboratory.py").write_text(source)
    where = 1 + source[: source.index(f"None.of_{method}")].count("\n")
    said = rf"tactuator\.procedures 'weighted' of foreign_laboratory 1\.0: .*/foreign_laboratory\.py, line {where}: A"
    text = protocol_text("trials = 24\nstep_db = 2.0").replace("[30, 90, 210]", "[30]")
    protocol, observers = parse_protocol(text, Protocol), simulated_observers(curve("bolanowski-1988"), 2, seed=5)
    if method == "learn":
        with pytest.raises(AttributeError):
            run_study(store, protocol, text, apparatus(), observers, SystemClock(), "finger")
    else:
        run_study(store, protocol, text, apparatus(), observers, SystemClock(), "finger")
        export(store, tmp_path / "out", "tidy")
        assert "no-refit" in (tmp_path / "out/thresholds.csv").read_text()
    answers = (tmp_path / "lab.db").stat().st_size and rows_of(store, select(func.count(schema.response.c.trial_id)))
    assert answers == [({"learn": 3, "estimate": 52}[method],)]
    failing = {"learn": lambda runs: runs.record(np.array([True])), "estimate": lambda runs: runs.estimate(0)}[method]
    command = sys.modules["tactuator.cli.main"]
    monkeypatch.setattr(command, "build_app", lambda needed: lambda **_: failing(protocol.begin(Playable())))
    assert main([]) == 70
    assert re.fullmatch(rf"tactuator: {said}.*\n", capsys.readouterr().err)


def test_docs__procedure_of_ones_own__runs_a_study_as_printed(install, store) -> None:
    page = (Path(__file__).parents[2] / "docs/experiments.md").read_text()
    example = page.partition("### A procedure of your own")[2].partition("```python\n")[2].partition("```")[0]
    install(GROUP, "printed", example, "Weighted", package="my_laboratory")
    text = protocol_text("trials = 24").replace('"weighted"', '"printed"').replace("[30, 90, 210]", "[30]")
    observers = simulated_observers(curve("bolanowski-1988"), 2, seed=5)
    run_study(store, parse_protocol(text, Protocol), text, apparatus(), observers, SystemClock(), "finger")
    found = thresholds(detection_runs(store))
    assert [(each.procedure, each.trials) for each in found] == [("printed", 24)] * 2
    assert all(-40.0 < each.own_db_sl < 20.0 for each in found)


def test_simulate__each_kind__is_judged_alike_by_its_own_rule(install) -> None:
    quality = simulate_kind("weighted", Setting(60, lapse=0.0, seed=3), trials=200)
    assert quality.trials_mean == 200.0
    # it balances where three right answers come to a wrong one: 75 % correct, a little below the display's point
    assert -1.5 < quality.bias_db < 0.0
    assert abs(quality.refit.bias_db) < 0.3
    with pytest.raises(BadInput, match="`trials` 10 with imece2004"):
        simulate_kind("imece2004", Setting(10), trials=10)
    with pytest.raises(BadInput, match="'guess'; expected curve, imece2004, quest-plus, up-down, weighted"):
        simulate_kind("guess", Setting(10))
    install(GROUP, "number", "Keys = 4\n", "Keys", package="second_laboratory")
    with pytest.raises(BadInput, match="'number' refers to 4; expected a table that inherits from Procedure"):
        simulate_kind("number", Setting(10))
    paper, updown = (simulate_kind(kind, Setting(50, seed=2)) for kind in ("imece2004", "up-down"))
    assert dataclasses.asdict(paper) == dataclasses.asdict(updown)
    assert simulate_kind("quest-plus", Setting(20, seed=2), trials=25).trials_mean == 25.0


TASK = """
from dataclasses import dataclass

from tactuator.experiment.task.task import Planned, Task, TaskPrompt, TaskState
from tactuator.experiment.trial import Tone, Trial
from tactuator.parameters import table
from tactuator.result import Chart, ChartLine, ResultTable


@table("[task]")
class Stronger(Task):
    finger: str
    trials: int = 4

    def asked(self, words):
        return TaskPrompt("Which was stronger?", (("1", ("1",)), ("2", ("2",))), ("1", "2"))

    def fingers_used(self):
        return (self.finger,)

    def plans(self, words):
        return (Planned(self.finger, 250.0, "two tones", self.trials),)

    def begin(self, index, place, seed):
        return StrongerRun(seed, self)

    def response_to(self, trial, felt_db_sl):
        return "1" if felt_db_sl[0] > felt_db_sl[1] else "2"

    def results(self, runs, words):
        rows = [(run.subject, str(sum(trial.correct for trial in run.trials))) for run in runs]
        return (ResultTable("stronger", ("subject", "right"), tuple(rows)),)

    def chart(self, runs, words):
        return Chart("trial", "right", [ChartLine(run.subject, [0, 1], [0, 1]) for run in runs])


@dataclass
class StrongerRun(TaskState):
    task: Stronger

    @property
    def share_done(self):
        return self.trials / self.task.trials

    def draw(self, number):
        tones = [(Tone("tone", self.task.finger, 250.0, level),) for level in (20.0, 40.0)]
        return None if number == self.task.trials else Trial.of(number, tones, ("1", "2"), "2")
"""


def test_foreign_task__from_protocol_to_figure__is_treated_as_ours(install, tmp_path) -> None:
    install("tactuator.tasks", "stronger", TASK, "Stronger", package="third_laboratory")
    text = PROTOCOL[: PROTOCOL.index("[procedure]")] + '[session]\npractice_trials = 2\n[task]\nkind = "stronger"\n'
    text += 'finger = "index"\n[[subject]]\ncode = "S1"\n'
    protocol, place = parse_protocol(text, StudyProtocol), apparatus()
    people = simulated_observers(curve("bolanowski-1988"), 1, seed=5)
    task = task_of(protocol, tmp_path, place)
    assert (protocol.asks, [run.typical_trials for run in task.runs(0)]) == ("stronger", [2, 4])
    assert [choice.keys for choice in task.question.choices] == [("1",), ("2",)]
    with opened_store(tmp_path / "lab.db") as store:
        for _ in range(2):  # once it is done, it is replayed
            run_study(store, protocol, text, place, people, SystemClock())
        assert export(store, tmp_path / "out", "bids") == 2 + 4
    (told,) = (tmp_path / "out").rglob("*task-stronger_run-02_beh.tsv")
    assert told.read_text().count("tone:index:250|tone:index:250") == 4
    found = judged(tmp_path / "lab.db", figures=tmp_path / "figures")
    assert (found.task, found.runs, found.results[0].rows) == ("stronger", 1, (("S1", "4"),))
    assert (tmp_path / "figures" / "stronger.svg").exists()
    with pytest.raises(BadInput, match="has no task of matches"):
        contours(tmp_path / "lab.db")

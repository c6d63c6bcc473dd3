"""Judging at the simulated display: levels and times as played, stopped sessions."""

from contextlib import closing

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.experiment.export import exported
from tactuator.experiment.protocol.file import StudyProtocol, parse_protocol
from tactuator.experiment.protocol.judging import JudgingProtocol
from tactuator.experiment.session.respondent import Respondent, run_session
from tactuator.experiment.session.studies import open_session, open_study, task_of
from tactuator.experiment.session.task import SystemClock
from tactuator.experiment.simulated.subjects import run_study, simulated_observers
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import answered_runs
from tactuator.experiment.task.magnitude_estimation import magnitudes
from tactuator.perception.curve import curve
from tests.experiment.session.apparatuses import apparatus

HEAD = """
[study]
name = "judged"
seed = 3
[session]
practice_trials = 2
[timing]
stimulus_s = 0.2
ramp_s = 0.02
gap_s = 0.05
lead_s = 0.05
[[subject]]
code = "S1"
"""
MATCHING = '[task]\nkind = "matching"\nfinger = "index"\ncomparison_fingers = ["thumb"]\ntrials = 24\n'
ESTIMATION = """[task]
kind = "magnitude-estimation"
finger = "index"
frequencies_hz = [40, 250]
levels_db_sl = [10, 30]
repeats = 1
"""
ORDER = """[task]
kind = "discrimination"
of = "order"
fingers = ["index", "thumb"]
frequencies_hz = [140]
procedure = { kind = "quest-plus", trials = 6 }
"""


class Level(Respondent):
    """Answers by what is commanded, and stops after so many trials."""

    def __init__(self, most: int = 10**6) -> None:
        self.most, self.asked = most, []

    def respond(self, trial) -> str:
        if len(self.asked) == self.most:
            raise KeyboardInterrupt
        self.asked.append(trial)
        levels = [self.felt_db(tones[0]) for tones in trial.tones]
        if not trial.responses:
            return f"{10.0 ** (levels[0] / 20.0):.3g}"
        return trial.responses[int(np.argmax(levels))]

    def felt_db(self, tone) -> float:
        return tone.level_db_sl


class Words(Respondent):
    def respond(self, trial) -> str:
        return "strong"


@pytest.fixture
def opened(tmp_path):
    stores = []

    def open_(text: str):
        stores.append(Store(tmp_path / "lab.db"))
        task = task_of(parse_protocol(text, StudyProtocol), tmp_path, apparatus())
        return stores[-1], open_study(stores[-1], task, text, SystemClock(), lambda code, visit: f"{code}-{visit}")

    yield open_
    for store in stores:
        store.close()


def test_matching__across_fingers__plays_each_tone_on_its_finger_at_its_level(opened) -> None:
    with pytest.raises(BadInput, match="toe"):
        opened(HEAD + MATCHING.replace('"thumb"', '"toe"'))
    store, study = opened(HEAD + MATCHING)
    run_session(open_session(study, "S1"), Level())
    with exported(store) as data:
        rows = [row for run in data.rows() for row in run.table("intervals")]
    assert {str(row["stimulus"]).split(":")[1] for row in rows} == {"index", "thumb"}
    # the paper's prefilter, which plays here, misses its curve above 150 Hz
    loud = [row for row in rows if row["commanded_db_sl"] > 20.0 and float(row["stimulus"].split(":")[2]) < 150.0]
    errors = [row["measured_db_sl"] - row["commanded_db_sl"] for row in loud]
    assert np.max(np.abs(errors)) < 1.0
    (run,) = answered_runs(store, "matching")
    matches = study.task.protocol.task.matches(run.trials)
    assert len(run.trials) == 24
    assert {*matches.comparison_db_sl, *matches.reference_db_sl} <= {row["measured_db_sl"] for row in rows}
    apart = (np.abs(matches.comparison_db_sl - matches.reference_db_sl) > 1.0) & (matches.frequency_hz < 150.0)
    assert np.array_equal(matches.stronger[apart], (matches.comparison_db_sl > matches.reference_db_sl)[apart])


@pytest.mark.parametrize(("task", "trials"), [(MATCHING, 26), (ESTIMATION, 6), (ORDER, 8)])
def test_session__stopped_in_the_middle__goes_on_with_the_same_trials(opened, task: str, trials: int) -> None:
    store, study = opened(HEAD + task)
    if task == ESTIMATION:
        with pytest.raises(BadInput, match="a number above 0"):
            run_session(open_session(study, "S1"), Words())
    first, rests, rig = Level(4), [], study.task.apparatus.rig
    rig.rest = lambda: rests.append(type(rig).rest(rig))
    with pytest.raises(KeyboardInterrupt):
        run_session(open_session(study, "S1"), first)
    assert len(rests) == 1
    second = Level()
    run_session(open_session(study, "S1"), second)
    assert len(first.asked) + len(second.asked) == trials
    tables = study.task.results(store, open_session(study, "S1").id) if task != MATCHING else ()
    assert (task == MATCHING) is not bool(tables)
    assert all("simulated: nobody felt this" in table.notes for table in tables)


def test_observed__by_people_whose_strength_is_a_power_function__gives_its_exponent(tmp_path) -> None:
    text = HEAD + ESTIMATION.replace("repeats = 1", "repeats = 6").replace("[40, 250]", "[60]")
    people = simulated_observers(curve("bolanowski-1988"), 1, seed=2)
    with closing(Store(tmp_path / "lab.db")) as store:
        run_study(store, parse_protocol(text, JudgingProtocol), text, apparatus(), people, SystemClock(), "finger")
        (found,) = magnitudes(answered_runs(store, "magnitude-estimation"))
        assert found.exponent.value == pytest.approx(0.6, abs=0.1)
        text = HEAD.replace("judged", "order") + ORDER
        with pytest.raises(BadInput, match="strength is not what it asks for"):
            run_study(store, parse_protocol(text, JudgingProtocol), text, apparatus(), people, SystemClock())


def test_answered_runs__two_studies_with_a_code_in_common__are_of_two_people(tmp_path) -> None:
    """Taken for one, their estimates were divided by a mean of both, and a mean over people counted one too few."""
    people = simulated_observers(curve("bolanowski-1988"), 1, seed=2)
    with closing(Store(tmp_path / "lab.db")) as store:
        for name in ("judged", "again"):
            text = HEAD.replace("judged", name) + ESTIMATION
            run_study(store, parse_protocol(text, JudgingProtocol), text, apparatus(), people, SystemClock(), "finger")
        assert {run.subject for run in answered_runs(store, "magnitude-estimation")} == {"S1-1", "S1-2"}

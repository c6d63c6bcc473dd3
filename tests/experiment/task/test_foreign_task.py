"""A task of another package: one file, in a protocol file, in a session at the display, with its results."""

from tactuator.experiment.protocol.file import parse_any_protocol
from tactuator.experiment.session.presented_session import PresentedSession, Respondent, run_session
from tactuator.experiment.session.studies import open_session, open_study, task_of
from tactuator.experiment.session.task import SystemClock
from tactuator.experiment.task.task_keys import GROUP
from tests.experiment.session.apparatuses import apparatus
from tests.experiment.session.test_judging_task import HEAD

SOURCE = '''
from typing import Annotated

from pydantic import Field

from tactuator.experiment.task.task_keys import TaskPrompt, Planned, TaskKeys, JudgedTone, Judgement
from tactuator.parameters import Whole, table
from tactuator.table import ResultTable


@table("[task]")
class Keys(TaskKeys):
    """Was it rough? Tones of two frequencies in turn."""

    trials: Annotated[Whole, Field(ge=1, description="trials")] = 4

    def asked(self, words):
        return TaskPrompt("Was it rough?", (("yes", ("y",)), ("no", ("n",))))

    def fingers_used(self):
        return ("index",)

    def plans(self, words):
        return (Planned("index", None, "roughness", self.trials),)

    def begin(self, index, place, seed):
        return Run(self)

    def results(self, runs, words):
        yes = sum(trial.correct for run in runs for trial in run.trials)
        return (ResultTable("roughness", ("rough",), ((str(yes),),)),)


class Run:
    def __init__(self, keys):
        self.keys, self.answered = keys, 0

    @property
    def progress(self):
        return self.answered / self.keys.trials

    def trial(self, number):
        if number >= self.keys.trials:
            return None
        tone = JudgedTone("tone", "index", 30.0 if number % 2 else 90.0, 20.0)
        return Judgement.of(number, [(tone,)], ("yes", "no"), "yes")

    def record(self, trial, response):
        self.answered += 1
'''
PROTOCOL = HEAD + '[task]\nkind = "roughness"\ntrials = 6\n'


class Rough(Respondent):
    def respond(self, trial) -> str:
        return "yes" if trial.tones[0][0].frequency_hz < 50.0 else "no"


def test_foreign_task__one_file_of_another_package__runs_a_session_and_has_results(install, store, tmp_path) -> None:
    install(GROUP, "roughness", SOURCE, "Keys")
    task = task_of(parse_any_protocol(PROTOCOL), tmp_path, apparatus())
    study = open_study(store, task, PROTOCOL, SystemClock(), lambda code, visit: f"{code}-{visit}")
    session = open_session(study, "S1")
    assert run_session(PresentedSession(session), Rough()) == 2 + 6
    assert task.results(store, session.id)[0].rows == (("3",),)
    assert open_session(study, "S1").stage == "done"  # replayed from the store

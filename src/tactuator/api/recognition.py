"""Subcommands of `experiment` on recognition: recognise, information."""

import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tactuator.api.experiment import StoreFile, Voided, opened_apparatus
from tactuator.api.option import Argument, Option
from tactuator.api.parameters import ControllerOption, DisplayOption, Place, RigOption, Seed
from tactuator.api.progress import working
from tactuator.errors import BadInput, visible
from tactuator.experiment.protocol.file import read_protocol
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.experiment.result import information as estimates
from tactuator.experiment.result.confusion import AbxResult, SubjectResult, information_table, recognition_results
from tactuator.experiment.result.information import Information
from tactuator.experiment.session.respondent import Respondent, run_session
from tactuator.experiment.session.session import Acknowledged
from tactuator.experiment.session.studies import fresh_token, open_session, open_study, task_of
from tactuator.experiment.session.task import NextTrial, SessionTask, SystemClock
from tactuator.experiment.simulated.subjects import ErringRespondent
from tactuator.experiment.store.records import Visit
from tactuator.experiment.store.store import Store, opened_store, sessions_of
from tactuator.experiment.trial import Trial
from tactuator.experiment.words import shipped_words
from tactuator.io.csv_tables import read_matrix
from tactuator.plain import picked
from tactuator.result import NOBODY_FELT_IT, Fact, Result, ResultTable, data, found


@dataclass(frozen=True, eq=False, repr=False)
class AnsweredResult(Result):
    """A subject who answered trials of a recognition experiment. simulated: nobody felt them."""

    subject: str
    trials: int
    store: Place
    simulated: bool = False

    def facts(self) -> Sequence[Fact]:
        felt = [found("simulated", NOBODY_FELT_IT.partition(": ")[2])] if self.simulated else []
        run = [Fact(name, getattr(self, name), name, summary=True) for name in ("subject", "trials", "store")]
        return [*run, Fact("simulated", self.simulated), *felt]


def recognise(
    protocol: Annotated[Place, Argument("Recognition protocol (TOML).", metavar="PROTOCOL", file=True)],
    store: StoreFile,
    subject: Annotated[str | None, Option("Code of the subject; default: the only one.")] = None,
    display: DisplayOption = None,
    controller: ControllerOption = None,
    rig: RigOption = "simulated",
    scripted_error: Annotated[float | None, Option("A script answers for the subject, wrong at this rate.")] = None,
    seed: Seed = 0,
) -> AnsweredResult:
    """Run a recognition experiment with a subject. Runs in the terminal; resumable."""
    folder = Path(protocol).parent
    study_protocol, text = read_protocol(Path(protocol), RecognitionProtocol)
    codes = [person.code for person in study_protocol.subject]
    if subject is None and len(codes) > 1:
        raise BadInput(f"{len(codes)} subjects are in the protocol", f"`subject` with one of {', '.join(codes)}")
    code = codes[0] if subject is None else subject
    scripted = None if scripted_error is None else ErringRespondent(scripted_error, np.random.default_rng([seed, 7]))
    speed = 1.0 if scripted is None else None
    with sessions_of(store), opened_apparatus(rig, display, controller, seed, speed) as place:
        task = task_of(study_protocol, folder, place)
        with opened_store(store) as database:
            study = open_study(database, task, text, SystemClock(), fresh_token, beside=folder)
            visit = Visit("person" if scripted is None else "script")
            session = open_session(study, code, visit=visit)
            with working(code, sum(run.trials or 0 for run in session.runs)) as step:
                trials = run_session(session, scripted or _terminal(task), lambda session: step(session.trials))
            simulated = scripted is not None or place.simulated
    return AnsweredResult(code, trials, store, simulated)


def _terminal(task: SessionTask) -> Respondent:
    question, words = task.question, task.words
    keys = {key: choice.response for choice in question.choices for key in choice.keys}
    offered = ", ".join(f"{choice.keys[0]} = {choice.label}" for choice in question.choices)

    class Terminal(Respondent):
        def agree(self, consent: str) -> bool:
            while True:
                typed = _typed(f"{consent}\n{words('terminal.agree')} [y/N]: ").lower()
                if typed in ("", "n", "no", "y", "yes"):
                    return typed in ("y", "yes")

        def pause(self) -> None:
            _typed(f"{words('terminal.break')}: ")

        def begin(self, following: NextTrial) -> None:
            _tell(following.planned.introduction)

        def respond(self, trial: Trial) -> str:
            while (typed := _typed(f"{question.prompt} {offered} > ")) not in keys:
                _tell(words("terminal.no_key", key=repr(typed)))
            return str(keys[typed])

        def learn(self, trial: Trial, told: Acknowledged) -> None:
            _tell(words("terminal.right") if told.correct else words("terminal.wrong", right=told.right))

    return Terminal()


def _tell(text: str) -> None:
    sys.stderr.write(f"{visible(text)}\n")
    sys.stderr.flush()


def _typed(prompt: str) -> str:
    sys.stderr.write(visible(prompt))
    sys.stderr.flush()
    line = sys.stdin.readline()
    if not line:
        raise KeyboardInterrupt
    return line.strip()


@dataclass(frozen=True, eq=False, repr=False)
class MatrixInformation(Result):
    """Information transfer of a confusion matrix."""

    matrix: Path
    information: Information

    def facts(self) -> Sequence[Fact]:
        bits = [found(name, words) for name, words in _bits(self.information).items()]
        return [
            Fact("matrix", self.matrix, "matrix", summary=True),
            *bits,
            *data(_information_document(self.information)),
        ]

    def tables(self) -> Sequence[ResultTable | str]:
        return [_information_table(str(self.matrix), self.information)]


@dataclass(frozen=True, eq=False, repr=False)
class StoreInformation(Result):
    """Information transfer of the studies of a store, of each subject and of all; and the results of ABX studies."""

    subjects: tuple[SubjectResult, ...]
    abx: tuple[AbxResult, ...]

    def facts(self) -> Sequence[Fact]:
        names = ("study", "paradigm", "subject", "labels", "seconds_per_stimulus", "simulated")
        results = [
            picked(each, *names, matrix="counts") | _information_document(each.information) for each in self.subjects
        ]
        bits = {_title(each): next(iter(_bits(each.information).values())) for each in self.subjects}
        correct = {
            f"{each.study}, {each.subject} (abx)": f"{each.trials} trials, {100 * each.share_correct:.1f} % correct"
            f"{f' ({NOBODY_FELT_IT})' if each.simulated else ''}"
            for each in self.abx
        }
        return [
            *(found(title, words) for title, words in (bits | correct).items()),
            *data({"results": results, "abx": [asdict(each) for each in self.abx]}),
        ]

    def tables(self) -> Sequence[ResultTable | str]:
        return [_information_table(_title(each), each.information, each.simulated) for each in self.subjects]


def information(
    store: Annotated[Place | None, Option("Database of recognition experiments.", file=True)] = None,
    matrix: Annotated[
        Place | None, Option("A confusion matrix of your own (CSV): a row a stimulus.", file=True)
    ] = None,
    study: Annotated[str | None, Option("Only the study of this name.")] = None,
    seconds: Annotated[float | None, Option("With --matrix: seconds a stimulus, for bits per second.")] = None,
    draws: Annotated[int, Option("Of the posterior, for the interval.", ge=100)] = 1000,
    seed: Seed = 0,
    voided: Voided = False,
) -> MatrixInformation | StoreInformation:
    """Estimate information transfer in five ways. One has an interval. From a store's studies, or any matrix."""
    if (store is None) == (matrix is None):
        raise BadInput("`store` and `matrix`", "one of the two")
    rng = np.random.default_rng(seed)
    if matrix is not None:
        counts = read_matrix(Path(matrix)).counts
        estimated = estimates.information(counts, rng, seconds_per_stimulus=seconds, draws=draws)
        return MatrixInformation(Path(matrix), estimated)
    if seconds is not None:
        raise BadInput("`seconds` with `store`", "`matrix`, since a store knows its stimuli's durations")
    assert store is not None
    with closing(Store(store, must_exist=True, voided=voided)) as database:
        subjects, abx = recognition_results(database, rng, study, draws)
    return StoreInformation(tuple(subjects), tuple(abx))


def _bits(information: Information) -> dict[str, str]:
    return {name: f"{estimate.bits:.2f} bits" for name, estimate in information.estimates.items()}


def _title(each: SubjectResult) -> str:
    return f"{each.study}, {'all subjects' if each.subject is None else each.subject} ({each.paradigm})"


def _information_table(title: str, information: Information, simulated: bool = False) -> ResultTable:
    return information_table(title, information, shipped_words("en"), simulated)


def _information_document(information: Information) -> dict[str, Any]:
    figures = asdict(information)
    del figures["reasons"]  # they are in warning and no_interval, as one line each
    for name, estimate in information.estimates.items():
        figures["estimates"][name]["categories"] = estimate.categories
    return figures

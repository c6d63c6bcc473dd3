"""Identification as a session: blocks, introductions, breaks, what is played when, and stores of before."""

import json
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment import records, schema
from tactuator.experiment.attend import Respondent
from tactuator.experiment.detection_task import DetectionTask
from tactuator.experiment.export import export
from tactuator.experiment.fingertip import touchable
from tactuator.experiment.identification_respondents import ErringRespondent, FeelingRespondent
from tactuator.experiment.identification_result import identification_results
from tactuator.experiment.identification_task import IdentificationTask
from tactuator.experiment.protocol_file import (
    parse_identification,
    parse_protocol,
    read_any_protocol,
    read_identification,
    read_protocol,
)
from tactuator.experiment.station import Station
from tactuator.experiment.store import Store
from tactuator.experiment.studies import open_session, open_study, task_of
from tactuator.rig.open import open_rig
from tests.experiment.identifying import Opened, controller, items, opened, protocol_text, scripted_answer  # noqa: F401
from tests.experiment.stations import PROTOCOL, ObedientClock, answer_one, begin, nobody, station, tokens

STORES = Path(__file__).with_name("stores")
THREE = ("M-index", "C-index", "L-index")


def answer(conduct, response=None, watch=nobody):
    following = conduct.present(watch)
    return conduct.answer(records.Answer(response or following.trial.correct, conduct.session.clock.utc()))


def go_on(conduct, trials):
    """Through consent, breaks and introductions; so many answers."""
    session = conduct.session
    steps = {"consent": session.give_consent, "break": session.end_break, "introduction": session.introduce}
    while trials and session.stage != "done":
        if session.stage == "trial":
            answer(conduct)
            trials -= 1
        else:
            steps[session.stage]()


def test_session__stages__are_consent_introduction_trials_break_introduction_trials(opened) -> None:
    study, _, _ = opened(protocol_text(test=1, consent="Agreed?"))
    session = (conduct := study.conduct()).session
    seen = []
    steps = {"consent": session.give_consent, "break": session.end_break, "introduction": session.introduce}
    while session.stage != "done":
        seen.append(session.stage)
        steps.get(session.stage, lambda: answer(conduct))()
    assert seen == ["consent", "introduction", *["trial"] * 3, "break", "introduction", *["trial"] * 3]
    assert session.upcoming is None
    assert session.progress == 1.0


def test_session__introduction__says_what_the_block_is(opened) -> None:
    study, _, _ = opened(protocol_text(test=4))
    conduct = study.conduct()
    told = conduct.session.upcoming
    assert told.introduction == "Block 1 of 2: training, 3 trials.\nAfter each answer you are told which was right."
    go_on(conduct, 3)
    assert conduct.session.upcoming.introduction.startswith("Block 2 of 2: test, 12 trials.\nYou are not told")


def test_session__trial_before_the_introduction_was_read__is_refused(opened) -> None:
    study, _, _ = opened(protocol_text())
    with pytest.raises(BadInput, match="'introduction'"):
        study.conduct().present(nobody)


@pytest.mark.parametrize(
    ("rules", "stages"),
    [
        ("break_between_blocks = false", []),
        ("break_after_trials = 2\nbreak_between_blocks = false", [2, 4]),
        ("break_after_trials = 2", [2, 3, 5]),
    ],
)
def test_session__break_rules__are_kept(opened, rules, stages) -> None:
    study, _, _ = opened(protocol_text(test=1, extra=f"[session]\n{rules}\n"))
    session = (conduct := study.conduct()).session
    breaks = []
    while session.stage != "done":
        if session.stage == "break":
            breaks.append(session.trials)
            session.end_break()
        elif session.stage == "introduction":
            session.introduce()
        else:
            answer(conduct)
    assert breaks == stages


def test_session__interrupted_over_and_over__asks_every_trial_once(opened) -> None:
    text = protocol_text(test=5)
    while True:
        study, _, store = opened(text)
        conduct = study.conduct()
        if conduct.session.stage == "done":
            break
        go_on(conduct, 3)
        if conduct.session.stage == "trial":
            conduct.present(nobody)  # played, never answered: played again
        store.close()
    with store.read() as connection:
        rows = connection.execute(
            select(schema.run.c.position, schema.trial).select_from(schema.run.join(schema.trial))
        )
        asked = [(row.position, row.number, row.correct_response) for row in rows]
    planned = [
        (run.position, trial.number, trial.correct)
        for run in conduct.session.runs
        for trial in study.task.course(run, 0, 0).planned_trials
    ]
    assert asked == planned


def test_session__years_between_two_trials__goes_on_in_the_same_block(opened) -> None:
    study, _, store = opened(protocol_text())
    conduct = study.conduct()
    go_on(conduct, 5)
    study.clock.jump(3e8)
    again = study.conduct()
    assert answer(again).number == 2
    with store.read() as connection:
        assert [run.attempt for run in connection.execute(select(schema.run))] == [0, 0]


def test_session__feedback__only_in_its_block(opened) -> None:
    study, _, _ = opened(protocol_text(test=1))
    conduct = study.conduct()
    go_on(conduct, 2)
    following = conduct.session.next_trial()
    wrong = next(one for one in following.trial.responses if one != following.trial.correct)
    told = answer(conduct, wrong)
    assert (told.correct, told.right) == (False, following.trial.correct)
    assert conduct.session.already(told.run, told.number).right == following.trial.correct
    conduct.session.end_break()
    conduct.session.introduce()
    told = answer(conduct)
    assert (told.correct, told.right) == (True, None)
    assert conduct.session.already(told.run, told.number).right is None


def test_session__block_given_up__is_left_out_of_the_results(opened) -> None:
    study, _, store = opened(protocol_text(training=0, test=2).replace("[[subject]]", BLOCK + "[[subject]]", 1))
    conduct = study.conduct()
    go_on(conduct, 4)
    conduct.give_up_run()
    go_on(conduct, 6)
    (result,), _ = identification_results(store, np.random.default_rng(0))
    assert result.counts.sum() == 6
    assert [one.state for one in conduct.session.tally] == ["stopped", "done"]
    assert [(one.answered, one.correct) for one in conduct.session.tally] == [(4, 4), (6, 6)]


BLOCK = '[[block]]\nkind = "test"\nrepetitions = 2\n'


def test_tally__after_a_restart__is_what_it_was(opened) -> None:
    text = protocol_text()
    study, _, store = opened(text)
    conduct = study.conduct()
    go_on(conduct, 5)
    answer(conduct, "MC-index")
    before = [(one.state, one.answered, one.correct) for one in conduct.session.tally]
    store.close()
    study, _, _ = opened(text)
    again = study.conduct().session
    assert [(one.state, one.answered, one.correct) for one in again.tally] == before
    assert again.course.picture()["counts"] == conduct.session.course.picture()["counts"]


# -- what is played


class Listener:
    """Keeps how many samples were played before each event."""

    def __init__(self, rig):
        self.samples, self.events, self._play = 0, [], rig.play
        rig.play = self.play

    def play(self, reference):
        self.samples += len(reference)
        return self._play(reference)

    def watch(self, interval, begins):
        self.events.append((interval, begins, self.samples))


@pytest.mark.parametrize("paradigm", ["identification", "middle-of-three", "abx"])
def test_trial__items_of_different_lengths__takes_as_long_whatever_is_played(opened, paradigm) -> None:
    study, rig, _ = opened(protocol_text(paradigm, training=0, test=3, labels=THREE))
    conduct = study.conduct()
    conduct.session.introduce()
    lengths, onsets, durations = set(), set(), set()
    for _ in range(9):
        listener = Listener(rig)
        following = conduct.present(listener.watch)
        durations.add(sum(study.task.items[label].duration_s for label in following.trial.stimuli))
        lengths.add(listener.samples)
        onsets.add(tuple(listener.events))
        conduct.answer(records.Answer(following.trial.correct, study.clock.utc()))
    assert len(durations) > 1
    assert len(lengths) == 1
    if paradigm == "abx":  # the only one whose intervals are shown
        assert len(onsets) == 1


@pytest.mark.parametrize(
    ("paradigm", "prompt", "responses", "intervals"),
    [
        ("identification", "Which one was it?", THREE, ()),
        ("middle-of-three", "Which one was in the middle?", THREE, ()),
        ("abx", "Was X like A or like B?", ("A", "B"), ("A", "B", "X")),
    ],
)
def test_question__paradigm__is_the_same_in_all_trials(opened, paradigm, prompt, responses, intervals) -> None:
    study, _, _ = opened(protocol_text(paradigm, labels=THREE))
    question = study.task.question
    assert (question.prompt, question.intervals) == (prompt, intervals)
    assert tuple(choice.response for choice in question.choices) == responses
    keys = [key for choice in question.choices for key in choice.keys]
    assert len(set(keys)) == len(keys)


# -- results


def test_results__of_a_session__are_matrix_and_information(opened) -> None:
    study, _, store = opened(protocol_text(test=4))
    conduct = study.conduct()
    go_on(conduct, 3)
    with pytest.raises(BadInput, match="no answers yet"):
        study.task.results(store, conduct.session.id)
    go_on(conduct, 12)
    matrix, information = study.task.results(store, conduct.session.id)
    assert matrix.columns[1:] == ("M-index", "C-index", "MC-index")
    assert [row[1:] for row in matrix.rows] == [("4", "0", "0"), ("0", "4", "0"), ("0", "0", "4")]
    assert information.rows[0][:2] == ("plug in", f"{np.log2(3):.2f}")
    assert "100.0 % correct" in information.notes[0]


def test_results__of_an_abx_session__are_the_share_of_right_answers(opened) -> None:
    study, _, store = opened(protocol_text("abx", training=0, test=1, subjects=("S1", "S2")))
    conduct = study.conduct("S2")
    go_on(conduct, 12)
    (table,) = study.task.results(store, conduct.session.id)
    assert table.rows == (("12", "100.0"),)


def test_results__of_a_detection_session__are_its_thresholds(tmp_path) -> None:
    clock, store = ObedientClock(), Store(tmp_path / "lab.db")
    conduct = begin(
        store, clock, PROTOCOL.replace("reversals = 6", "reversals = 4").replace("averaged = 4", "averaged = 2")
    )
    session = conduct.session
    answer_one(conduct, clock)
    with pytest.raises(BadInput, match="no done run"):
        session.task.results(store, session.id)
    while session.stage != "done":
        if session.stage == "break":
            session.end_break()
        answer_one(conduct, clock)
    (table,) = session.task.results(store, session.id)
    assert sorted(row[2] for row in table.rows) == ["100", "200", "50"]
    store.close()


@pytest.mark.parametrize(
    ("form", "names"),
    [
        ("tidy", {"trials.csv"}),
        ("psych-ds", {"data/subject-S1_task-identification_data.csv"}),
        (
            "bids",
            {
                f"sub-S1/beh/sub-S1_task-identification_run-{run}_beh.{kind}"
                for run in ("01", "02")
                for kind in ("tsv", "json")
            },
        ),
    ],
)
def test_export__identification__is_under_its_own_task(opened, tmp_path, form, names) -> None:
    study, _, store = opened(protocol_text(test=1))
    go_on(study.conduct(), 6)
    assert export(store, tmp_path / "out", form) == 6
    written = {str(path.relative_to(tmp_path / "out")) for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert names <= written
    assert not any("detection" in name for name in written)
    if form == "bids":
        sidecar = json.loads((tmp_path / "out" / "sub-S1/beh/sub-S1_task-identification_run-01_beh.json").read_text())
        assert sidecar["TaskName"] == "identification"


# -- who answers


class Unwilling(ErringRespondent):
    def agree(self, consent):
        assert consent == "Agreed?"
        return False


def test_attend__no_consent__ends_at_once_and_stores_nothing(opened) -> None:
    study, _, store = opened(protocol_text(consent="Agreed?"))
    assert study.run("S1", Unwilling(0.0, np.random.default_rng(0))) == 0
    with store.read() as connection:
        assert connection.execute(select(schema.run)).all() == []
        assert records.sessions(connection, study.study)[0].consented_utc is None


def test_attend__respondent__is_told_of_runs_breaks_and_right_answers_in_order(opened) -> None:
    told = []

    class Telling(Respondent):
        def pause(self):
            told.append("break")

        def begin(self, following):
            told.append(following.planned.title)

        def respond(self, trial):
            told.append("?")
            return trial.correct

        def learn(self, trial, acknowledged):
            told.append(acknowledged.right == trial.correct)

    study, _, _ = opened(protocol_text(test=1))
    assert study.run("S1", Telling()) == 6
    training = [item for _ in range(3) for item in ("?", True)]
    assert told == ["Block 1 of 2: training", *training, "break", "Block 2 of 2: test", "?", "?", "?"]


def test_attend__board_in_this_process__is_felt_at_its_ports(controller, items, tmp_path) -> None:
    text = protocol_text(training=2, test=4)
    rig, store = open_rig("in-process", controller.display, 1), Store(tmp_path / "lab.db")
    rig.load(controller)
    study = Opened(parse_identification(text), text, items, Station(rig, controller, "in-process"), store)
    subject = FeelingRespondent("identification", controller.display, np.random.default_rng(2))
    subject.listen(touchable(rig, "in-process"))
    assert study.run("S1", subject) == 18
    (result,), _ = identification_results(store, np.random.default_rng(0))
    assert result.information.share_correct > 0.9
    rig.close()
    store.close()


class Blind:
    """A rig whose display no program can touch."""

    rate_hz, channels = 4000.0, ("index",)


def test_touchable__rig_without_ports__is_refused() -> None:
    with pytest.raises(
        BadInput, match="simulated subjects at board:COM3; allowed: at a rig whose display is simulated"
    ):
        touchable(Blind(), "board:COM3")


def test_touchable__board_with_a_real_display__is_refused() -> None:
    class Board(Blind):
        def finger(self, channel):
            raise BadInput("this display is real: a finger goes onto it by hand; allowed: a simulated display")

        load = play = stream = drive = rest = print

    with pytest.raises(BadInput, match="real"):
        touchable(Board(), "board:COM3")


# -- protocols of either kind


def test_protocol__of_either_kind__is_recognised_by_its_content(tmp_path, items, controller) -> None:
    for name, text, kind in (("d", PROTOCOL, DetectionTask), ("i", protocol_text(), IdentificationTask)):
        path = tmp_path / f"{name}.toml"
        path.write_text(text)
        read, own = read_any_protocol(path)
        assert own == text
        place = station() if kind is DetectionTask else opened_station(controller)
        assert isinstance(task_of(read, items, place), kind)


def opened_station(made):
    rig = open_rig("simulated", made.display, 0)
    rig.load(made)
    return Station(rig, made, "simulated")


@pytest.mark.parametrize(
    ("read", "text", "message"),
    [
        (read_protocol, protocol_text(), "allowed: a detection protocol"),
        (read_identification, PROTOCOL, "allowed: an identification protocol"),
        (read_identification, "", "has the tables none"),
        (read_any_protocol, "[study", "allowed: TOML"),
        (read_any_protocol, '[[item]]\nlabel = "a"', "study"),
        (read_any_protocol, PROTOCOL + "[extra]\nx = 1\n", "extra"),
        (read_any_protocol, protocol_text(extra="[session]\nbreak_s = -1\n"), "session.break_s"),
        (read_any_protocol, protocol_text(subjects=("S1", "S1")), "subject codes S1, S1; allowed: each once"),
        (read_any_protocol, PROTOCOL.replace('"S2"', '"S1"'), "subject codes S1, S1; allowed: each once"),
    ],
)
def test_protocol__of_the_wrong_kind_or_amiss__is_refused_in_one_line(tmp_path, read, text, message) -> None:
    (tmp_path / "p.toml").write_text(text)
    with pytest.raises(BadInput, match=message) as refusal:
        read(tmp_path / "p.toml")
    assert "\n" not in str(refusal.value)


# -- stores that version 0.1.0 wrote


def restored(path, name) -> Store:
    connection = sqlite3.connect(path)
    connection.executescript((STORES / name).read_text())
    connection.close()
    return Store(path)


def test_store_of_0_1_0__identification_begun__goes_on_at_the_same_trial(tmp_path, items, controller) -> None:
    store = restored(tmp_path / "lab.db", "identification-0.1.0.sql")
    with store.begin() as connection:
        text = connection.execute(select(schema.study.c.protocol_toml)).scalar_one()
        task = IdentificationTask.load(parse_identification(text), items, opened_station(controller))
        for item in task.items.values():  # the samples' last bits are this machine's
            row = schema.stimulus.update().where(schema.stimulus.c.label == item.label)
            connection.execute(row.values(sha256=item.sha256))
    clock = ObedientClock()
    session = open_session(store, task, open_study(store, task, text, clock, ["never used"]), "S1", clock)
    assert [(one.state, one.answered, one.correct) for one in session.tally] == [("done", 3, 3), ("running", 7, 7)]
    assert session.next_trial().trial.number == 7
    assert session.stage == "trial"
    store.close()


def test_store_of_0_1_0__detection_begun__goes_on_at_the_same_trial(tmp_path) -> None:
    store = restored(tmp_path / "lab.db", "detection-0.1.0.sql")
    clock = ObedientClock()
    task = DetectionTask(parse_protocol(PROTOCOL), station())
    session = open_session(store, task, open_study(store, task, PROTOCOL, clock, tokens(task.protocol)), "S1", clock)
    following = session.next_trial()
    assert (following.planned.position, following.trial.number) == (1, 7)
    whole = Store(tmp_path / "whole.db")
    conduct = begin(whole, clock)
    for _ in range(9):
        answer_one(conduct, clock)
    assert conduct.session.next_trial().trial == following.trial
    store.close()
    whole.close()


def test_session__unknown_subject__is_refused(opened) -> None:
    study, _, _ = opened(protocol_text())
    with pytest.raises(BadInput, match="subject 'S9' is not in the protocol; allowed: S1"):
        study.conduct("S9")

"""Identification as a session: blocks, introductions, breaks, and stores of before."""

import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_identification, parse_protocol
from tactuator.experiment.result.confusion import identification_results
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.session.identification_task import IdentificationTask
from tactuator.experiment.session.studies import open_session, open_study
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, apparatus, begin, nobody, token
from tests.experiment.session.identifying import (  # noqa: F401
    answer,
    controller,
    go_on,
    items,
    opened,
    opened_apparatus,
    protocol_text,
)

STORES = Path(__file__).parents[1] / "store" / "stores"


def test_session__stages__are_consent_introduction_trials_break_introduction_trials(opened) -> None:
    study, _, _ = opened(protocol_text(test=1, consent="Agreed?"))
    session = (presented := study.presented()).session
    seen = []
    steps = {"consent": session.give_consent, "break": session.end_break, "introduction": session.introduce}
    while session.stage != "done":
        seen.append(session.stage)
        steps.get(session.stage, lambda: answer(presented))()
    assert seen == ["consent", "introduction", *["trial"] * 3, "break", "introduction", *["trial"] * 3]
    assert session.upcoming is None
    assert session.progress == 1.0


def test_session__introduction__says_what_the_block_is(opened) -> None:
    study, _, _ = opened(protocol_text(test=4))
    presented = study.presented()
    told = presented.session.upcoming
    assert told.introduction == "Block 1 of 2: training, 3 trials.\nAfter each answer you are told which was right."
    go_on(presented, 3)
    assert presented.session.upcoming.introduction.startswith("Block 2 of 2: test, 12 trials.\nYou are not told")


def test_session__trial_before_the_introduction_was_read__is_refused(opened) -> None:
    study, _, _ = opened(protocol_text())
    with pytest.raises(BadInput, match="'introduction'"):
        study.presented().present(nobody)


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
    session = (presented := study.presented()).session
    breaks = []
    while session.stage != "done":
        if session.stage == "break":
            breaks.append(session.trials)
            session.end_break()
        elif session.stage == "introduction":
            session.introduce()
        else:
            answer(presented)
    assert breaks == stages


def test_session__interrupted_over_and_over__asks_every_trial_once(opened) -> None:
    text = protocol_text(test=5)
    while True:
        study, _, store = opened(text)
        presented = study.presented()
        if presented.session.stage == "done":
            break
        go_on(presented, 3)
        if presented.session.stage == "trial":
            presented.present(nobody)  # played, never answered: played again
        store.close()
    with store.read() as connection:
        rows = connection.execute(
            select(schema.run.c.position, schema.trial).select_from(schema.run.join(schema.trial))
        )
        asked = [(row.position, row.number, row.correct_response) for row in rows]
    planned = [
        (run.position, trial.number, trial.correct)
        for run in presented.session.runs
        for trial in study.task.course(run, 0).planned_trials
    ]
    assert asked == planned


def test_session__years_between_two_trials__goes_on_in_the_same_block(opened) -> None:
    study, _, store = opened(protocol_text())
    presented = study.presented()
    go_on(presented, 5)
    study.clock.jump(3e8)
    again = study.presented()
    assert answer(again).number == 2
    with store.read() as connection:
        assert [run.attempt for run in connection.execute(select(schema.run))] == [0, 0]


def test_session__feedback__only_in_its_block(opened) -> None:
    study, _, _ = opened(protocol_text(test=1))
    presented = study.presented()
    go_on(presented, 2)
    following = presented.session.next_trial()
    wrong = next(one for one in following.trial.responses if one != following.trial.correct)
    told = answer(presented, wrong)
    assert (told.correct, told.right) == (False, following.trial.correct)
    assert presented.session.already(told.run, told.number).right == following.trial.correct
    presented.session.end_break()
    presented.session.introduce()
    told = answer(presented)
    assert (told.correct, told.right) == (True, None)
    assert presented.session.already(told.run, told.number).right is None


def test_session__block_given_up__is_left_out_of_the_results(opened) -> None:
    study, _, store = opened(protocol_text(training=0, test=2).replace("[[subject]]", BLOCK + "[[subject]]", 1))
    presented = study.presented()
    go_on(presented, 4)
    presented.give_up_run()
    go_on(presented, 6)
    (result,), _ = identification_results(store, np.random.default_rng(0))
    assert result.counts.sum() == 6
    assert [one.state for one in presented.session.tally] == ["stopped", "done"]
    assert [(one.answered, one.correct) for one in presented.session.tally] == [(4, 4), (6, 6)]


BLOCK = '[[block]]\nkind = "test"\nrepetitions = 2\n'


def test_tally__after_a_restart__is_what_it_was(opened) -> None:
    text = protocol_text()
    study, _, store = opened(text)
    presented = study.presented()
    go_on(presented, 5)
    answer(presented, "MC-index")
    before = [(one.state, one.answered, one.correct) for one in presented.session.tally]
    store.close()
    study, _, _ = opened(text)
    again = study.presented().session
    assert [(one.state, one.answered, one.correct) for one in again.tally] == before
    assert again.course.picture()["counts"] == presented.session.course.picture()["counts"]


def restored(path, name) -> Store:
    connection = sqlite3.connect(path)
    connection.executescript((STORES / name).read_text())
    connection.close()
    return Store(path)


def test_store_of_0_1_0__identification_begun__goes_on_at_the_same_trial(tmp_path, items, controller) -> None:
    store = restored(tmp_path / "lab.db", "identification-0.1.0.sql")
    with store.begin() as connection:
        text = connection.execute(select(schema.protocol_version.c.toml)).scalar_one()
        task = IdentificationTask.load(parse_identification(text), items, opened_apparatus(controller))
        for item in task.items.values():  # the samples' last bits are this machine's
            row = schema.stimulus.update().where(schema.stimulus.c.label == item.label)
            connection.execute(row.values(sha256=item.sha256))
    clock = ObedientClock()
    session = open_session(open_study(store, task, text, clock, token), "S1")
    assert [(one.state, one.answered, one.correct) for one in session.tally] == [("done", 3, 3), ("running", 7, 7)]
    assert session.next_trial().trial.number == 7
    assert session.stage == "trial"
    store.close()


BEFORE = PROTOCOL.replace("[30, 90, 210]", "[50, 100, 200]")
"""The detection protocol that the store of 0.1.0 was made with."""


def test_store_of_0_1_0__detection_begun__goes_on_at_the_same_trial(tmp_path) -> None:
    store = restored(tmp_path / "lab.db", "detection-0.1.0.sql")
    clock = ObedientClock()
    task = DetectionTask(parse_protocol(BEFORE), apparatus())
    session = open_session(open_study(store, task, BEFORE, clock, token), "S1")
    following = session.next_trial()
    assert (following.planned.position, following.trial.number) == (1, 7)
    whole = Store(tmp_path / "whole.db")
    presented = begin(whole, clock)
    for _ in range(9):
        answer_one(presented, clock)
    now = presented.session.next_trial().trial  # of today's protocol: 50 Hz stands too near mains for a new study
    assert now.placement is not None
    assert replace(now, placement=replace(now.placement, frequency_hz=50.0)) == following.trial
    store.close()
    whole.close()


def test_session__unknown_subject__is_refused(opened) -> None:
    study, _, _ = opened(protocol_text())
    with pytest.raises(BadInput, match="subject 'S9' is not in the study; allowed: S1"):
        study.presented("S9")

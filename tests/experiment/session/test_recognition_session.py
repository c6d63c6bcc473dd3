"""Recognition as a session: blocks, introductions, breaks."""

import numpy as np
import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.result.confusion import recognition_results
from tactuator.experiment.store import schema
from tests.experiment.session.apparatuses import nobody, rows_of
from tests.experiment.session.recognising import (  # noqa: F401
    answer,
    controller,
    go_on,
    items,
    opened,
    opened_apparatus,
    protocol_text,
)


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


def test_session__years_between_two_trials__goes_on_in_the_same_block(opened) -> None:
    study, _, store = opened(protocol_text())
    presented = study.presented()
    go_on(presented, 5)
    study.clock.jump(3e8)
    again = study.presented()
    assert answer(again).number == 2
    assert [run.attempt for run in rows_of(store, select(schema.run))] == [0, 0]


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
    (result,), _ = recognition_results(store, np.random.default_rng(0))
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


def test_session__unknown_subject__is_refused(opened) -> None:
    study, _, _ = opened(protocol_text())
    with pytest.raises(BadInput, match="subject 'S9' is not in the study; allowed: S1"):
        study.presented("S9")

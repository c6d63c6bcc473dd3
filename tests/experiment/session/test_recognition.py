"""Recognition: plans, sessions of blocks and breaks, what is played and asked, a scripted run from items to bits."""

import json

import numpy as np
import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.export import export
from tactuator.experiment.protocol.recognition import plan_trials
from tactuator.experiment.result.confusion import recognition_results
from tactuator.experiment.session.respondent import Respondent
from tactuator.experiment.simulated.subjects import ErringRespondent
from tactuator.experiment.store import records, schema
from tactuator.rig.rig import require_finger_ports
from tactuator.rig.simulated import SimulatedRig
from tactuator.speech.items import Component, WaveformSet, write_waveforms
from tests.experiment.session.apparatuses import nobody, rows_of
from tests.experiment.session.recognising import SET, THREE, answer, controller, go_on, items, opened, protocol_text  # noqa: F401

TRIALS = ["trial"] * 3


@pytest.mark.parametrize(
    ("rules", "stages"),
    [
        ("", ["introduction", *TRIALS, "break", "introduction", *TRIALS]),
        ("break_between_blocks = false", ["introduction", *TRIALS, "introduction", *TRIALS]),
        (
            "break_after_trials = 2",
            ["introduction", *TRIALS[:2], "break", "trial", "break", "introduction", *TRIALS[:2], "break", "trial"],
        ),
    ],
)
def test_session__stages__are_those_of_its_blocks_and_break_rules(opened, rules, stages) -> None:
    study, _, _ = opened(protocol_text(test=1, consent="Agreed?", extra=f"[session]\n{rules}\n"))
    with pytest.raises(BadInput, match="subject 'S9' is not in the study; expected S1"):
        study.presented("S9")
    session = presented = study.presented()
    seen, introduced = [], []
    steps = {"consent": session.give_consent, "break": session.end_break, "introduction": session.introduce}
    while session.stage != "done":
        seen.append(session.stage)
        if session.stage == "introduction":
            introduced.append(session.upcoming.introduction)
            with pytest.raises(BadInput, match="'introduction'"):
                presented.present(nobody)
        steps.get(session.stage, lambda: answer(presented))()
    assert seen == ["consent", *stages]
    assert introduced[0] == "Block 1 of 2: training, 3 trials.\nAfter each answer you see which was right."
    assert introduced[1].startswith("Block 2 of 2: test, 3 trials.\nYou do not see")
    assert (session.upcoming, session.progress) == (None, 1.0)


def test_session__feedback__only_in_its_block(opened) -> None:
    study, _, _ = opened(protocol_text(test=1))
    presented = study.presented()
    go_on(presented, 2)
    following = presented.next_trial()
    wrong = next(one for one in following.trial.responses if one != following.trial.correct)
    told = answer(presented, wrong)
    assert (told.correct, told.right) == (False, following.trial.correct)
    assert presented.already(told.run, told.number).right == following.trial.correct
    presented.end_break()
    presented.introduce()
    told = answer(presented)
    assert (told.correct, told.right) == (True, None)
    assert presented.already(told.run, told.number).right is None


def test_session__block_given_up__is_left_out_of_the_results(opened) -> None:
    study, _, store = opened(protocol_text(training=0, test=2).replace("[[subject]]", BLOCK + "[[subject]]", 1))
    presented = study.presented()
    go_on(presented, 4)
    presented.stop_run()
    go_on(presented, 6)
    (result,), _ = recognition_results(store, np.random.default_rng(0))
    assert result.counts.sum() == 6
    assert [one.state for one in presented.tally] == ["stopped", "done"]
    assert [(one.answered, one.correct) for one in presented.tally] == [(4, 4), (6, 6)]


BLOCK = '[[block]]\nkind = "test"\nrepetitions = 2\n'


def test_session__opened_again_years_later__goes_on_in_the_same_block(opened) -> None:
    text = protocol_text()
    study, _, store = opened(text)
    presented = study.presented()
    go_on(presented, 5)
    answer(presented, "MC-index")
    before = [(one.state, one.answered, one.correct) for one in presented.tally]
    store.close()
    study, _, store = opened(text)
    study.clock.jump(3e8)
    again = study.presented()
    assert [(one.state, one.answered, one.correct) for one in again.tally] == before
    assert again.running.state.picture()["counts"] == presented.running.state.picture()["counts"]
    assert answer(again).number == 3
    assert [run.attempt for run in rows_of(store, select(schema.run))] == [0, 0]


class Listener:
    """Keeps what was played, and how much of it before each event."""

    def __init__(self, rig):
        self.rows, self.events, self._play = np.zeros((0, len(rig.channels))), [], type(rig).play
        rig.play = lambda reference: self.play(rig, reference)

    def play(self, rig, reference):
        self.rows = np.concatenate([self.rows, reference])
        return self._play(rig, reference)

    def watch(self, interval, begins):
        self.events.append((interval, begins, len(self.rows)))


@pytest.mark.parametrize(
    ("paradigm", "prompt", "responses", "intervals"),
    [
        ("recognition", "Which one was it?", THREE, ()),
        ("middle-of-three", "Which one was in the middle?", THREE, ()),
        ("abx", "Was X like A or like B?", ("A", "B"), ("A", "B", "X")),
    ],
)
def test_trial__items_of_different_lengths__takes_as_long_and_asks_the_same(
    opened, paradigm, prompt, responses, intervals
) -> None:
    study, rig, _ = opened(protocol_text(paradigm, training=0, test=3, labels=THREE))
    presented, question = study.presented(), study.task.question
    assert (question.prompt, question.intervals) == (prompt, intervals)
    assert tuple(choice.response for choice in question.choices) == responses
    keys = [key for choice in question.choices for key in choice.keys]
    assert len(set(keys)) == len(keys)
    presented.introduce()
    lengths, onsets, durations = set(), set(), set()
    for _ in range(9):
        listener = Listener(rig)
        following = presented.present(listener.watch)
        durations.add(sum(study.task.items[label].duration_s for label in following.trial.stimuli))
        lengths.add(len(listener.rows))
        start, longest = 0, max(len(item.reference) for item in study.task.items.values())
        for label in following.trial.stimuli:
            reference = study.task.items[label].reference
            assert np.array_equal(listener.rows[start : start + len(reference)], reference)
            start += round(0.05 * rig.rate_hz) + (longest if paradigm == "abx" else len(reference))
        onsets.add(tuple(listener.events))
        presented.answer(records.Answer(following.trial.correct, study.clock.utc()))
    assert len(durations) > 1
    assert len(lengths) == 1
    if paradigm == "abx":  # the only one whose intervals are shown
        assert len(onsets) == 1


def test_results__of_a_session__are_matrix_and_information(opened) -> None:
    study, _, store = opened(protocol_text(test=4))
    presented = study.presented()
    go_on(presented, 3)
    with pytest.raises(BadInput, match="no answers yet"):
        study.task.results(store, presented.id)
    go_on(presented, 12)
    matrix, information = study.task.results(store, presented.id)
    assert matrix.columns[1:] == ("M-index", "C-index", "MC-index")
    assert [row[1:] for row in matrix.rows] == [("4", "0", "0"), ("0", "4", "0"), ("0", "0", "4")]
    assert information.rows[0][:2] == ("plug in", f"{np.log2(3):.2f}")
    assert any("100.0 % correct" in note for note in information.notes)


def test_results__of_an_abx_session__are_the_share_of_right_answers(opened) -> None:
    study, _, store = opened(protocol_text("abx", training=0, test=1, subjects=("S1", "S2")))
    presented = study.presented("S2")
    go_on(presented, 12)
    (table,) = study.task.results(store, presented.id)
    assert (table.rows, "simulated: nobody felt this" in table.notes) == ((("12", "100.0"),), True)


def test_export__recognition__is_under_its_own_task(opened, tmp_path) -> None:
    study, _, store = opened(protocol_text(test=1))
    go_on(study.presented(), 6)
    of_bids = [f"sub-S1/beh/sub-S1_task-recognition_run-0{run}_beh.{end}" for run in (1, 2) for end in ("tsv", "json")]
    for form, names in (
        ("tidy", ["trials.csv"]),
        ("psych-ds", ["data/subject-S1_task-recognition_description-trials_data.csv"]),
        ("bids", of_bids),
    ):
        assert export(store, tmp_path / form, form) == 6
        written = {str(path.relative_to(tmp_path / form)) for path in (tmp_path / form).rglob("*") if path.is_file()}
        assert set(names) <= written
        assert not any("detection" in name for name in written)
    assert json.loads((tmp_path / "bids" / of_bids[1]).read_text())["TaskName"] == "recognition"


def test_run_session__respondent__is_told_of_runs_breaks_and_right_answers_in_order(opened) -> None:
    told, agreed = [], []

    class Telling(Respondent):
        def agree(self, consent):
            assert consent == "Agreed?"
            return bool(agreed)

        def pause(self):
            told.append("break")

        def begin(self, following):
            told.append(following.planned.title)

        def respond(self, trial):
            told.append("?")
            return trial.correct

        def learn(self, trial, acknowledged):
            told.append(acknowledged.right == trial.correct)

    study, _, store = opened(protocol_text(test=1, consent="Agreed?", subjects=("S1", "S2")))
    assert study.run("S1", Telling()) == 0
    assert rows_of(store, select(schema.run)) == []
    assert rows_of(store, select(schema.session.c.consented_utc, schema.session.c.ended))[0] == (None, "declined")
    agreed.append(True)
    assert study.run("S2", Telling()) == 6
    training = [item for _ in range(3) for item in ("?", True)]
    assert told == ["Block 1 of 2: training", *training, "break", "Block 2 of 2: test", "?", "?", "?"]


def test_plans__of_each_paradigm__have_every_item_equally_often(controller) -> None:
    rig = SimulatedRig(controller.display)
    require_finger_ports(rig, "simulated")
    rig._fingers = ()
    with pytest.raises(BadInput, match="subjects at board:COM3; expected at a rig whose display is simulated"):
        require_finger_ports(rig, "board:COM3")
    labels = ("a", "b", "c")
    trials = plan_trials("recognition", labels, 4, np.random.default_rng(1))
    assert sorted(trial.correct for trial in trials) == sorted(labels * 4)
    assert all(trial.stimuli == (trial.correct,) and trial.responses == labels for trial in trials)
    assert trials == plan_trials("recognition", labels, 4, np.random.default_rng(1))
    assert trials != plan_trials("recognition", labels, 4, np.random.default_rng(2))
    middle = plan_trials("middle-of-three", ("a", "b"), 50, np.random.default_rng(1))
    assert all(len(trial.stimuli) == 3 and trial.stimuli[1] == trial.correct for trial in middle)
    assert {trial.stimuli[0] for trial in middle} == {"a", "b"}
    abx = plan_trials("abx", labels, 2, np.random.default_rng(1))
    assert len(abx) == 3 * 2 * 2 * 2
    for trial in abx:
        a, b, x = trial.stimuli
        assert x == {"A": a, "B": b}[trial.correct]
    assert sum(trial.correct == "A" for trial in abx) == len(abx) // 2


def test_study__scripted_subject__matrix_and_bits_come_out_of_the_store(opened):
    study, _, store = opened(protocol_text(test=20))
    answered = study.run("S1", ErringRespondent(0.2, np.random.default_rng(3)))
    assert answered == 3 + 60
    (result,), abx = recognition_results(store, np.random.default_rng(0))
    assert abx == []
    assert result.simulated
    assert result.counts.sum() == 60  # training does not count
    np.testing.assert_array_equal(result.counts.sum(axis=1), 20)
    assert result.information.share_correct == pytest.approx(0.8, abs=0.12)
    assert result.seconds_per_stimulus == pytest.approx(0.125)
    bits = result.information.estimates["plug_in"].bits
    assert 0.4 < bits < np.log2(3)
    assert result.information.bits_per_second["plug_in"] == pytest.approx(bits / 0.125)
    assert result.information.warning is None
    kinds = rows_of(store, select(schema.run.c.paradigm, schema.run.c.practice, schema.run.c.state))
    assert kinds == [("recognition", True, "done"), ("recognition", False, "done")]
    assert len(rows_of(store, select(schema.interval))) == 63


def test_study__middle_of_three__takes_seconds_from_onset_to_onset(opened):
    study, _, store = opened(protocol_text("middle-of-three", training=0, test=5))
    with pytest.raises(BadInput, match="no answers of any recognition study"):
        recognition_results(store, np.random.default_rng(0))
    study.run("S1", ErringRespondent(0.0, np.random.default_rng(3)))
    (result,), _ = recognition_results(store, np.random.default_rng(0))
    assert result.seconds_per_stimulus == pytest.approx(0.175)


def test_study__item_changed_since_or_missing_or_impossible_rate__is_refused(opened, items, controller):
    text = protocol_text()
    opened(text)
    with pytest.raises(BadInput, match="file not found"):
        opened(text.replace('file = "C-index.wav"', 'file = "gone.wav"'))
    louder = WaveformSet(
        0.125, components=(Component("M", 30.0, 30.0), Component("C", 240.0, 40.0)), fingers=(("index",),)
    )
    try:
        write_waveforms(louder, controller, items)
        with pytest.raises(BadInput, match="not what it was"):
            opened(text)
    finally:
        write_waveforms(SET, controller, items)
    for error in (-0.1, 1.1):
        with pytest.raises(BadInput, match="0 to 1"):
            ErringRespondent(error, np.random.default_rng(0))


def test_study__two_subjects__each_and_together(opened):
    study, _, store = opened(protocol_text(test=5, subjects=("S1", "S2")))
    for code, error in (("S1", 0.0), ("S2", 0.5)):
        study.run(code, ErringRespondent(error, np.random.default_rng(3)))
    results, _ = recognition_results(store, np.random.default_rng(0))
    assert [result.subject for result in results] == ["S1", "S2", None]
    np.testing.assert_array_equal(results[2].counts, results[0].counts + results[1].counts)
    assert results[0].information.warning is not None

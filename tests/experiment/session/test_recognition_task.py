"""What recognition trials play and show, and what results and exports say of them."""

import json

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.experiment.export import export
from tactuator.experiment.store import records
from tests.experiment.session.apparatuses import PROTOCOL, answer_one, begin
from tests.experiment.session.recognising import THREE, answer, controller, go_on, items, opened, protocol_text  # noqa: F401


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


@pytest.mark.parametrize("paradigm", ["recognition", "middle-of-three", "abx"])
def test_trial__items_of_different_lengths__takes_as_long_whatever_is_played(opened, paradigm) -> None:
    study, rig, _ = opened(protocol_text(paradigm, training=0, test=3, labels=THREE))
    presented = study.presented()
    presented.session.introduce()
    lengths, onsets, durations = set(), set(), set()
    for _ in range(9):
        listener = Listener(rig)
        following = presented.present(listener.watch)
        durations.add(sum(study.task.items[label].duration_s for label in following.trial.stimuli))
        lengths.add(listener.samples)
        onsets.add(tuple(listener.events))
        presented.answer(records.Answer(following.trial.correct, study.clock.utc()))
    assert len(durations) > 1
    assert len(lengths) == 1
    if paradigm == "abx":  # the only one whose intervals are shown
        assert len(onsets) == 1


@pytest.mark.parametrize(
    ("paradigm", "prompt", "responses", "intervals"),
    [
        ("recognition", "Which one was it?", THREE, ()),
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


def test_results__of_a_session__are_matrix_and_information(opened) -> None:
    study, _, store = opened(protocol_text(test=4))
    presented = study.presented()
    go_on(presented, 3)
    with pytest.raises(BadInput, match="no answers yet"):
        study.task.results(store, presented.session.id)
    go_on(presented, 12)
    matrix, information = study.task.results(store, presented.session.id)
    assert matrix.columns[1:] == ("M-index", "C-index", "MC-index")
    assert [row[1:] for row in matrix.rows] == [("4", "0", "0"), ("0", "4", "0"), ("0", "0", "4")]
    assert information.rows[0][:2] == ("plug in", f"{np.log2(3):.2f}")
    assert any("100.0 % correct" in note for note in information.notes)


def test_results__of_an_abx_session__are_the_share_of_right_answers(opened) -> None:
    study, _, store = opened(protocol_text("abx", training=0, test=1, subjects=("S1", "S2")))
    presented = study.presented("S2")
    go_on(presented, 12)
    (table,) = study.task.results(store, presented.session.id)
    assert table.rows == (("12", "100.0"),)


def test_results__of_a_detection_session__are_its_thresholds(store, clock) -> None:
    presented = begin(
        store, clock, PROTOCOL.replace("reversals = 6", "reversals = 4").replace("averaged = 4", "averaged = 2")
    )
    session = presented.session
    answer_one(presented, clock)
    with pytest.raises(BadInput, match="no done run"):
        session.task.results(store, session.id)
    while session.stage != "done":
        if session.stage == "break":
            session.end_break()
        answer_one(presented, clock)
    (table,) = session.task.results(store, session.id)
    assert sorted(row[2] for row in table.rows) == ["210", "30", "90"]


@pytest.mark.parametrize(
    ("form", "names"),
    [
        ("tidy", {"trials.csv"}),
        ("psych-ds", {"data/subject-S1_task-recognition_description-trials_data.csv"}),
        (
            "bids",
            {
                f"sub-S1/beh/sub-S1_task-recognition_run-{run}_beh.{kind}"
                for run in ("01", "02")
                for kind in ("tsv", "json")
            },
        ),
    ],
)
def test_export__recognition__is_under_its_own_task(opened, tmp_path, form, names) -> None:
    study, _, store = opened(protocol_text(test=1))
    go_on(study.presented(), 6)
    assert export(store, tmp_path / "out", form) == 6
    written = {str(path.relative_to(tmp_path / "out")) for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert names <= written
    assert not any("detection" in name for name in written)
    if form == "bids":
        sidecar = json.loads((tmp_path / "out" / "sub-S1/beh/sub-S1_task-recognition_run-01_beh.json").read_text())
        assert sidecar["TaskName"] == "recognition"

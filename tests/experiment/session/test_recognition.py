"""Recognition experiments: plans, a scripted run from items to bits through engine and store, refusals."""

import numpy as np
import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_recognition
from tactuator.experiment.protocol.recognition import block_trials, plan_trials
from tactuator.experiment.result.confusion import recognition_results
from tactuator.experiment.simulated.sitting import ErringRespondent
from tactuator.experiment.store import schema
from tactuator.speech.waveforms import Component, WaveformSet, write_waveforms
from tests.experiment.session.feeling import FeelingRespondent
from tests.experiment.session.recognising import SET, controller, items, opened, protocol_text  # noqa: F401


def test_plan__recognition__every_item_equally_often_and_the_seed_decides():
    labels = ("a", "b", "c")
    trials = plan_trials("recognition", labels, 4, np.random.default_rng(1))
    assert sorted(trial.correct for trial in trials) == sorted(labels * 4)
    assert all(trial.stimuli == (trial.correct,) and trial.responses == labels for trial in trials)
    assert trials == plan_trials("recognition", labels, 4, np.random.default_rng(1))
    assert trials != plan_trials("recognition", labels, 4, np.random.default_rng(2))


def test_plan__middle_of_three__asks_for_the_middle_one():
    trials = plan_trials("middle-of-three", ("a", "b"), 50, np.random.default_rng(1))
    assert all(len(trial.stimuli) == 3 and trial.stimuli[1] == trial.correct for trial in trials)
    assert {trial.stimuli[0] for trial in trials} == {"a", "b"}


def test_plan__abx__every_pair_in_both_orders_and_x_either():
    trials = plan_trials("abx", ("a", "b", "c"), 2, np.random.default_rng(1))
    assert len(trials) == 3 * 2 * 2 * 2
    for trial in trials:
        a, b, x = trial.stimuli
        assert x == {"A": a, "B": b}[trial.correct]
    assert sum(trial.correct == "A" for trial in trials) == len(trials) // 2


def test_study__scripted_subject__matrix_and_bits_come_out_of_the_store(opened):
    study, _, store = opened(protocol_text(test=60))
    answered = study.run("S1", ErringRespondent(0.2, np.random.default_rng(3)))
    assert answered == 3 + 180
    (result,), abx = recognition_results(store, np.random.default_rng(0))
    assert abx == []
    assert result.simulated
    assert result.counts.sum() == 180  # training does not count
    np.testing.assert_array_equal(result.counts.sum(axis=1), 60)
    assert result.information.share_correct == pytest.approx(0.8, abs=0.08)
    assert result.seconds_per_stimulus == pytest.approx(0.125)
    bits = result.information.estimates["plug_in"].bits
    assert 0.4 < bits < np.log2(3)
    assert result.information.bits_per_second["plug_in"] == pytest.approx(bits / 0.125)
    assert result.information.warning is None
    with store.read() as connection:
        runs = connection.execute(select(schema.run)).all()
        assert [(run.paradigm, run.practice, run.state) for run in runs] == [
            ("recognition", True, "done"),
            ("recognition", False, "done"),
        ]
        assert len(connection.execute(select(schema.interval)).all()) == 183


def test_study__subject_who_goes_by_what_is_felt__learns_and_tells_items_apart(opened, controller):
    study, rig, store = opened(protocol_text(training=4, test=12))
    subject = FeelingRespondent("recognition", controller.display, np.random.default_rng(2))
    subject.listen(rig)
    study.run("S1", subject)
    (result,), _ = recognition_results(store, np.random.default_rng(0))
    assert result.information.share_correct > 0.9


def test_study__abx__share_of_right_answers(opened, controller):
    study, rig, store = opened(protocol_text("abx", training=0, test=2))
    subject = FeelingRespondent("abx", controller.display, np.random.default_rng(2))
    subject.listen(rig)
    study.run("S1", subject)
    results, (one,) = recognition_results(store, np.random.default_rng(0))
    assert results == []
    assert one.trials == 24
    assert one.simulated
    assert one.share_correct > 0.9


def test_study__middle_of_three__seconds_from_onset_to_onset(opened):
    study, _, store = opened(protocol_text("middle-of-three", training=0, test=5))
    study.run("S1", ErringRespondent(0.0, np.random.default_rng(3)))
    (result,), _ = recognition_results(store, np.random.default_rng(0))
    assert result.seconds_per_stimulus == pytest.approx(0.175)


class Leaves(ErringRespondent):
    """Answers some trials and is gone."""

    left = 10

    def respond(self, trial):
        if self.left == 0:
            raise KeyboardInterrupt
        self.left -= 1
        return super().respond(trial)


def test_study__interrupted__goes_on_at_the_same_trial_and_rests(opened):
    text = protocol_text(test=10)
    study, rig, store = opened(text)
    rests, rest = [], rig.rest
    rig.rest = lambda: rests.append(rest())
    with pytest.raises(KeyboardInterrupt):
        study.run("S1", Leaves(0.0, np.random.default_rng(0)))
    assert len(rests) == 1
    store.close()
    again, _, store = opened(text)
    assert again.run("S1", ErringRespondent(0.0, np.random.default_rng(0))) == 33 - 10
    with store.read() as connection:
        asked = [row.correct_response for row in connection.execute(select(schema.trial).order_by(schema.trial.c.id))]
    planned = [trial.correct for block in (0, 1) for trial in block_trials(parse_recognition(text), 0, block)]
    assert asked == planned
    assert again.run("S1", ErringRespondent(0.0, np.random.default_rng(0))) == 0


def test_study__two_subjects__each_and_together(opened):
    study, _, store = opened(protocol_text(test=5, subjects=("S1", "S2")))
    for code, error in (("S1", 0.0), ("S2", 0.5)):
        study.run(code, ErringRespondent(error, np.random.default_rng(3)))
    results, _ = recognition_results(store, np.random.default_rng(0))
    assert [result.subject for result in results] == ["S1", "S2", None]
    np.testing.assert_array_equal(results[2].counts, results[0].counts + results[1].counts)
    assert results[0].information.warning is not None


def test_study__item_changed_since__refused(opened, items, controller):
    text = protocol_text()
    opened(text)
    louder = WaveformSet(
        0.125, components=(Component("M", 30.0, 30.0), Component("C", 240.0, 40.0)), fingers=(("index",),)
    )
    try:
        write_waveforms(louder, controller, items)
        with pytest.raises(BadInput, match="not what it was"):
            opened(text)
    finally:
        write_waveforms(SET, controller, items)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('label = "C-index"', 'label = "M-index"'), "item labels"),
        (('key = "2"', 'key = "1"'), "keys"),
        (('paradigm = "recognition"', 'paradigm = "guessing"'), "paradigm"),
        (("repetitions = 20", "repetitions = 0"), "repetitions"),
        (("[study]", "[studies]"), "study"),
        (('code = "S1"', 'code = "S 1"'), "code"),
    ],
)
def test_protocol__amiss__refused_in_one_line(change, words):
    with pytest.raises(BadInput, match=words) as refusal:
        parse_recognition(protocol_text().replace(*change, 1))
    assert "\n" not in str(refusal.value)


def test_study__item_file_missing__refused(opened):
    with pytest.raises(BadInput, match="no such file"):
        opened(protocol_text().replace('file = "C-index.wav"', 'file = "gone.wav"'))


def test_results__store_without_answers__refused(opened):
    _, _, store = opened(protocol_text())
    with pytest.raises(BadInput, match="no answers of any recognition study"):
        recognition_results(store, np.random.default_rng(0))


@pytest.mark.parametrize("error", [-0.1, 1.1])
def test_erring_respondent__impossible_rate__refused(error):
    with pytest.raises(BadInput, match="0 to 1"):
        ErringRespondent(error, np.random.default_rng(0))

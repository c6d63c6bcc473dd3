"""Recognition experiments: plans, a scripted run from items to bits through engine and store, refusals."""

import numpy as np
import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.protocol.recognition import plan_trials
from tactuator.experiment.result.confusion import recognition_results
from tactuator.experiment.simulated.sitting import ErringRespondent
from tactuator.experiment.store import schema
from tactuator.speech.waveforms import Component, WaveformSet, write_waveforms
from tests.experiment.session.apparatuses import rows_of
from tests.experiment.session.recognising import SET, controller, items, opened, protocol_text  # noqa: F401


def test_plan__of_each_paradigm__has_every_item_equally_often_and_the_seed_decides():
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
    with pytest.raises(BadInput, match="no such file"):
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

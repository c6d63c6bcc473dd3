"""A trial whose timing the rig missed is noted and played again; an answer belongs after its trial."""

import numpy as np
import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import Answer
from tactuator.rig.board.stream import StreamDry
from tactuator.rig.sound.stream import SoundGap
from tests.experiment.session.apparatuses import begin, nobody, rows_of


@pytest.fixture
def presented(store, clock):
    return begin(store, clock)


DRY = StreamDry("the stream ran dry 240 samples after its beginning", "a faster host", 12)
GAP = SoundGap("the sound card told of a gap 0.060 s after the beginning")


def dry(rig, times, monkeypatch, error=DRY):
    """Let the rig's stream run dry in the middle of a trial, so many times."""
    stream, left = rig.stream, [times]

    def drying(blocks):
        for count, trace in enumerate(stream(blocks)):
            if count == 3 and left[0]:
                left[0] -= 1
                raise error
            yield trace

    monkeypatch.setattr(rig, "stream", drying)


@pytest.mark.parametrize(
    ("times", "error", "words"), [(2, DRY, "the stream ran dry 240 samples"), (1, GAP, "the sound card told of a gap")]
)
def test_present__timing_missed__is_noted_and_the_trial_played_again(
    presented, monkeypatch, times, error, words
) -> None:
    dry(presented.session.task.apparatus.rig, times, monkeypatch, error)
    following = presented.present(nobody)
    noted = rows_of(presented.session.store, select(schema.event))
    assert [event.kind for event in noted] == ["timing-missed"] * times
    assert f"trial 0: {words}" in noted[0].detail
    presented.answer(Answer(following.trial.correct, presented.session.clock.utc()))
    (row,) = rows_of(presented.session.store, select(schema.trial))
    onsets = [onset for (onset,) in rows_of(presented.session.store, select(schema.interval.c.onset_s))]
    assert row.presentations == times + 1
    length_s = round(2 / 30 * 4000) / 4000  # two periods of 30 Hz, in whole samples
    assert np.allclose(onsets, 0.01 + (length_s + 0.01) * np.arange(3), atol=1e-9)
    dry(presented.session.task.apparatus.rig, 9, monkeypatch)
    with pytest.raises(StreamDry):  # again and again: the rig's fault
        presented.present(nobody)
    assert len(rows_of(presented.session.store, select(schema.event))) == times + 3
    with pytest.raises(BadInput, match="no trial waits"):
        presented.answer(Answer("1", presented.session.clock.utc()))


def test_answer__earlier_than_its_trial_by_either_clock__is_refused_and_the_trial_stands(presented) -> None:
    clock = presented.session.clock
    following = presented.present(nobody)
    with pytest.raises(BadInput, match=r"0.500 s before its last interval had ended"):
        presented.answer(Answer("1", clock.utc(), received_s=clock.monotonic_s() - 0.5))
    with pytest.raises(BadInput, match="50 ms before it was asked for"):
        presented.answer(Answer("1", clock.utc(), 100.0, 50.0))
    assert presented.answer(Answer("1", clock.utc(), 100.0, 100.0, (), clock.monotonic_s())).number == 0
    assert following.trial.number == 0

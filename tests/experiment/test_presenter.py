"""A trial as one stretch of the rig's time: onsets, lamps, stops, marks."""

from itertools import pairwise

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.experiment.presenter import Halted, Presenter
from tactuator.experiment.trial import Marks
from tactuator.rig.board.link import LinkClient
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.rig import Trace
from tactuator.rig.transport import InProcess
from tests.experiment.session.apparatuses import apparatus
from tests.rig.guard.guarded import designed

RATE_HZ = 4000.0


class Recorder:
    """A rig that plays what it gets, `behind` samples late to tell of it, and keeps it."""

    rate_hz, channels = RATE_HZ, ("index", "thumb")

    def __init__(self, behind=0):
        self.behind, self.played, self.rests, self.began_at, self.rows_played = behind, [], 0, 7000, 0

    def stream(self, blocks):
        rows = np.concatenate(list(blocks))
        self.played.append(rows)
        for start in range(0, len(rows), 40 + self.behind):
            self.rows_played = min(start + 40 + self.behind, len(rows))
            yield self.trace(rows[start : start + 40 + self.behind])

    def trace(self, rows):
        return Trace(RATE_HZ, self.channels, rows, rows, rows, np.zeros(rows.shape, dtype=np.bool_))

    def rest(self):
        self.rests += 1


def tones(count=3, samples=2000):
    wave = np.sin(2 * np.pi * 100.0 * np.arange(samples) / RATE_HZ)
    return [np.column_stack([wave, np.zeros(samples)])] * count


def test_present__intervals__are_one_stretch_with_the_protocols_gaps() -> None:
    rig, told = Recorder(behind=71), []
    shown = Presenter(rig, lambda interval, begins: told.append((interval, begins))).present(tones(), 0.3, 0.25, 0.1)
    assert told == [(0, True), (0, False), (1, True), (1, False), (2, True), (2, False)]
    assert all(0.0 <= one.lamp_late_s < 111 / RATE_HZ for one in shown.intervals)
    assert any(one.lamp_late_s > 0.0 for one in shown.intervals)
    (played,) = rig.played  # one stream
    assert len(played) == round((0.3 + 3 * 0.5 + 2 * 0.25 + 0.1) * RATE_HZ)
    assert [one.onset_s for one in shown.intervals] == [0.3, 1.05, 1.8]
    assert {one.duration_s for one in shown.intervals} == {0.5}
    assert (shown.rig_tick, shown.lasted_s) == (7000, pytest.approx(2.4))
    for one, reference in zip(shown.intervals, tones(), strict=True):
        assert np.array_equal(one.trace.reference, reference)


def test_present__halted_or_of_other_channels__rests_the_rig_within_a_piece_or_is_refused() -> None:
    rig, asked = Recorder(), []
    presenter = Presenter(rig, halted=lambda: bool(asked.append(1)) or len(asked) == 5)
    with pytest.raises(Halted):
        presenter.present(tones(), 0.3, 0.25)
    assert (len(asked), rig.rests) == (5, 1)
    for shape in ((100,), (100, 3)):
        with pytest.raises(BadInput, match=r"allowed: \(samples, 2\)"):
            Presenter(Recorder()).present([np.zeros(shape)], 0.1, 0.1)
    for amiss in ({"level_db_sl": 56.0}, {"tap_s": 0.0}, {"pause_s": -0.1}, {"after_s": 6.0}, {"frequency_hz": np.nan}):
        with pytest.raises(BadInput, match=r"\[marks\]: .*allowed"):
            Marks("thumb", **amiss)


def test_present__rig_ahead_of_its_trace__lights_lamps_by_the_rigs_own_count() -> None:
    class Ahead(Recorder):
        """A rig that tells its time every 16 rows, in empty pieces, and gives the trace of all only at the end."""

        def stream(self, blocks):
            rows = np.concatenate(list(blocks))
            for self.rows_played in range(0, len(rows), 16):
                yield self.trace(rows[:0])
            yield self.trace(rows)

    told, rig = [], Ahead()
    shown = Presenter(rig, lambda *edge: told.append((*edge, rig.rows_played))).present(tones(), 0.3, 0.25)
    assert [(interval, at) for interval, begins, at in told if begins] == [(0, 1200), (1, 4208), (2, 7200)]
    assert [one.lamp_late_s for one in shown.intervals] == [0.0, 8 / RATE_HZ, 0.0]
    simulated = apparatus().rig
    stands, presenter = [], Presenter(simulated, lambda interval, begins: stands.append(simulated._ticks))
    shown = presenter.present([np.zeros((777, len(simulated.channels)))] * 2, 0.1001, 0.2)
    assert [stand - shown.rig_tick for stand in stands] == [400, 1177, 1977, 2754]
    assert {one.lamp_late_s for one in shown.intervals} == {0.0}


def test_marks__each_interval__is_announced_by_as_many_taps_and_the_end_by_a_long_one() -> None:
    rig = Recorder()
    marks = Marks("thumb", frequency_hz=60.0, level_db_sl=20.0, tap_s=0.08, pause_s=0.12, after_s=0.5)
    silent = [np.zeros((400, 2))] * 3
    shown = Presenter(rig, marks=marks).present(silent, 0.3, 0.3)
    felt = np.abs(rig.played[0][:, 1]) > 1e-9
    starts = np.flatnonzero(np.diff(np.concatenate([[0], np.convolve(felt, np.ones(200), "same") > 0])) == 1)
    onsets = [round(one.onset_s * RATE_HZ) for one in shown.intervals]
    before = [int(np.sum(starts < onsets[0]))]
    before += [int(np.sum((starts >= a) & (starts < b))) for a, b in pairwise(onsets)]
    assert before == [1, 2, 3]
    assert int(np.sum(starts > onsets[2])) == 1
    for onset in onsets:  # nothing for half a second before an interval, nothing during it
        assert not felt[onset - 2000 : onset + 400].any()
    assert np.abs(rig.played[0][:, 1]).max() == pytest.approx(10.0, rel=0.02)
    assert shown.lasted_s == pytest.approx(len(rig.played[0]) / RATE_HZ)


def lag(first, second) -> int:
    """By how many samples the second signal is behind the first, from their correlation within 200 samples."""
    middle = first[220:-220] - first.mean()
    return int(np.argmax([middle @ second[220 + k : len(second) - 220 + k] for k in range(-200, 201)])) - 200


def test_present__board_whose_time_goes_on__keeps_the_onsets_and_lights_lamps_within_twenty_milliseconds() -> None:
    """Onsets are where the board's own sensor finds the same displacement again, within a sample.

    The lamps' witness is the board's own counter, read where it stands in memory: no request of the test moves it.
    """
    transport = InProcess()
    rig = BoardRig(LinkClient(transport), designed().display, waits=False, sleep=lambda seconds: None)
    rig.simulate(1)
    rig.load(designed())
    stands: list[tuple[int, bool, int]] = []
    presenter = Presenter(rig, lambda *edge: stands.append((*edge, int(transport.board.tick))))
    late_s, stored_s, lags = [], [], []
    for trial in range(2):
        stands.clear()
        time_s = np.arange(701 + 37 * trial) / RATE_HZ
        wave = 100.0 * np.sin(2.0 * np.pi * 70.0 * time_s) * np.sin(np.pi * time_s / time_s[-1])
        tone = np.outer(wave, np.eye(len(rig.channels))[rig.channels.index("index")])
        shown = presenter.present([tone] * 3, 0.31, 0.13)
        begun = [tick for _, begins, tick in stands if begins]
        assert len(begun) == 3
        for tick, one in zip(begun, shown.intervals, strict=True):
            late_s.append((tick - shown.rig_tick) / RATE_HZ - one.onset_s)
            stored_s.append(one.lamp_late_s)
        felt = [one.trace.position_v[:, rig.channels.index("index")] for one in shown.intervals]
        lags += [lag(felt[0], other) for other in felt[1:]]
    assert {abs(one) <= 1 for one in lags} == {True}, lags
    assert min(late_s) >= 0.0
    assert max(late_s) <= 0.020, sorted(late_s)
    assert np.abs(np.array(stored_s) - late_s).max() <= 0.010

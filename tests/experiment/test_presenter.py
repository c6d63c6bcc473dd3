"""A trial as one stretch of the rig's time: onsets, lamps, stops, marks; and as a Lab Streaming Layer has it."""

import json
import os
import subprocess
import sys
import uuid
from contextlib import closing, contextmanager
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.presenter import THIS_MACHINE, Halted, Outlet, Presenter
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store
from tactuator.experiment.trial import Marks
from tactuator.rig.board.link import LinkClient
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.rig import Trace
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import InProcess
from tests.experiment.session.apparatuses import PROTOCOL, apparatus, controller, rows_of
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


def test_present__intervals__are_one_stretch_with_gaps_halted_or_refused() -> None:
    rig, told = Recorder(behind=71), []
    shown = Presenter(rig, lambda interval, begins: told.append((interval, begins))).present(tones(), 0.3, 0.25, 0.1)
    assert told == [(0, True), (0, False), (1, True), (1, False), (2, True), (2, False)]
    assert all(0.0 <= one.cue_delay_s < 111 / RATE_HZ for one in shown.intervals)
    assert any(one.cue_delay_s > 0.0 for one in shown.intervals)
    (played,) = rig.played  # one stream
    assert len(played) == round((0.3 + 3 * 0.5 + 2 * 0.25 + 0.1) * RATE_HZ)
    assert [one.onset_s for one in shown.intervals] == [0.3, 1.05, 1.8]
    assert {one.duration_s for one in shown.intervals} == {0.5}
    assert (shown.rig_tick, shown.lasted_s) == (7000, pytest.approx(2.4))
    for one, reference in zip(shown.intervals, tones(), strict=True):
        assert np.array_equal(one.trace.reference, reference)
    rig, asked = Recorder(), []
    presenter = Presenter(rig, halted=lambda: bool(asked.append(1)) or len(asked) == 5)
    with pytest.raises(Halted):
        presenter.present(tones(), 0.3, 0.25)
    assert (len(asked), rig.rests) == (5, 1)
    for shape in ((100,), (100, 3)):
        with pytest.raises(BadInput, match=r"\(samples, 2\)"):
            Presenter(Recorder()).present([np.zeros(shape)], 0.1, 0.1)
    for amiss in ({"level_db_sl": 56.0}, {"tap_s": 0.0}, {"pause_s": -0.1}, {"after_s": 6.0}, {"frequency_hz": np.nan}):
        with pytest.raises(BadInput, match=r"\[marks\]: .*; "):
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
    assert [one.cue_delay_s for one in shown.intervals] == [0.0, 8 / RATE_HZ, 0.0]
    simulated = apparatus().rig
    stands, presenter = [], Presenter(simulated, lambda interval, begins: stands.append(simulated._ticks))
    shown = presenter.present([np.zeros((777, len(simulated.channels)))] * 2, 0.1001, 0.2)
    assert [stand - shown.rig_tick for stand in stands] == [400, 1177, 1977, 2754]
    assert {one.cue_delay_s for one in shown.intervals} == {0.0}


def test_marks__each_interval__is_announced_by_as_many_taps() -> None:
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
    middle = first[220:-220] - first.mean()
    return int(np.argmax([middle @ second[220 + k : len(second) - 220 + k] for k in range(-200, 201)])) - 200


def test_present__board_in_free_run__lights_lamps_within_twenty_milliseconds() -> None:
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
            stored_s.append(one.cue_delay_s)
        felt = [one.trace.position_v[:, rig.channels.index("index")] for one in shown.intervals]
        lags += [lag(felt[0], other) for other in felt[1:]]
    assert {abs(one) <= 1 for one in lags} == {True}, lags
    assert min(late_s) >= 0.0
    assert max(late_s) <= 0.020, sorted(late_s)
    assert np.abs(np.array(stored_s) - late_s).max() <= 0.010


ONE = PROTOCOL[: PROTOCOL.rindex("[[subject]]")].replace("[30, 90, 210]", "[30, 210]")


def on_this_machine(folder: Path, more: str = "") -> dict[str, str]:
    """The environment of programs that are heard here alone."""
    (folder / "lsl.cfg").write_text(THIS_MACHINE.replace("[lab]", f"[lab]\n{more}"))
    return {"LSLAPICFG": str(folder / "lsl.cfg")}


@contextmanager
def recorded(path: Path, part: str, more: dict[str, str]):
    """The process of a recorder of both streams, which writes the file when the context ends."""
    command = [sys.executable, "-m", "tests.experiment.session.recorder", path, part]
    with subprocess.Popen(command, stdin=-1, stdout=-1, env=os.environ | more, text=True) as recorder:
        try:
            yield recorder
        finally:
            recorder.communicate(timeout=60.0)
        assert recorder.returncode == 0


def read(path: Path):
    """The two streams of a file: events, numbers by their label, stamps, and how both are described."""
    events, levels = streams = json.loads(path.read_text())
    about = [ElementTree.fromstring(stream["about"]) for stream in streams]
    assert events["stamps"] == levels["stamps"]
    labels = [label.text for label in about[1].iter("label")]
    numbers = dict(zip(labels, np.array(levels["rows"]).T, strict=True))
    return [text for (text,) in events["rows"]], numbers, np.array(levels["stamps"]), about


def compare(path: Path, store: Path) -> tuple[np.ndarray, np.ndarray]:
    """Hold levels and answers against the store; return the onsets' times by the rig's clock as stored, and stamps."""
    trial, tables = (schema.trial.c.run_id, schema.trial.c.number), schema.trial.join(schema.interval)
    with closing(Store(store, must_exist=True)) as opened:
        rows = rows_of(opened, select(schema.interval, *trial, schema.trial.c.rig_tick).select_from(tables))
        responses = rows_of(opened, select(schema.response, *trial).select_from(schema.response.join(schema.trial)))
    intervals = {(row.run_id, row.number, row.position): row for row in rows}
    answers = {(row.run_id, row.number): row for row in responses}
    events, numbers, stamps, _ = read(path)
    onsets = [at for at, event in enumerate(events) if event.startswith("onset/")]
    given = [at for at, event in enumerate(events) if event.startswith("answer/")]
    assert len(onsets) + len(given) == len(events)
    assert [tuple(numbers[name][at] for name in ("run", "trial", "interval")) for at in onsets] == list(intervals)
    assert [tuple(numbers[name][at] for name in ("run", "trial")) for at in given] == list(answers)
    rig_s = []
    for at, row in zip(onsets, intervals.values(), strict=True):
        assert events[at] == f"onset/{row.stimulus}"
        levels = [np.nan if row.commanded_db_sl is None else row.commanded_db_sl, row.measured_db_sl]
        got = [numbers[name][at] for name in ("commanded_db_sl", "measured_db_sl")]
        assert got == pytest.approx(levels, nan_ok=True)
        rig_s.append(row.rig_tick / controller().rate_hz + row.onset_s)
    assert numbers["rig_s"][onsets] == pytest.approx(rig_s, abs=1e-9)
    for at, row in zip(given, answers.values(), strict=True):
        assert (events[at], numbers["correct"][at]) == (f"answer/{row.response}", row.correct)
        assert stamps[at] >= stamps[at - 1]
    return np.array(rig_s), stamps[onsets]


def test_observe__with_a_recorder__has_every_onset_within_one_sample_of_the_stores(tmp_path) -> None:
    (tmp_path / "protocol.toml").write_text(ONE.replace("[30, 210]", "[30]"))
    heard = on_this_machine(tmp_path, f"SessionID = {uuid.uuid4().hex}")
    command = ["-m", "tactuator", "experiment", "observe", "protocol.toml", "--store", "lab.db", "--lsl"]
    with recorded(tmp_path / "all.json", "tactuator simulated", heard):
        subprocess.run(
            [sys.executable, *command], cwd=tmp_path, env=os.environ | heard, check=True, stderr=-3, stdout=-3
        )
    rig_s, stamps = compare(tmp_path / "all.json", tmp_path / "lab.db")
    assert rig_s.size > 40
    assert np.abs((stamps - stamps[0]) - (rig_s - rig_s[0])).max() < 1.0 / controller().rate_hz


def test_outlet__without_pylsl__says_what_installs_it(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pylsl", None)
    with pytest.raises(BadInput, match=r"pylsl is missing: install it with `pip install 'tactuator\[lsl\]'`"):
        Outlet(SimulatedRig(controller().display), "simulated", "a display")

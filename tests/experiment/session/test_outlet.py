"""Onsets, levels and answers as a recorder of Lab Streaming Layer on this machine gets them."""

import os
import subprocess
import sys
import uuid
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.presenter import THIS_MACHINE, UNITS, Outlet
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.session.presented_session import PresentedSession
from tactuator.experiment.session.studies import open_session, open_study
from tactuator.experiment.session.task import Apparatus, SystemClock
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import Answer
from tactuator.experiment.store.store import Store
from tactuator.rig.simulated import PacedRig, SimulatedRig
from tests.experiment.session.apparatuses import PROTOCOL, controller, token

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
    """The two streams of a file: events, numbers by their label, stamps."""
    import pyxdf  # of the tests that need it alone

    streams, _ = pyxdf.load_xdf(path)
    by_type = {stream["info"]["type"][0]: stream for stream in streams}
    events, levels = by_type["Markers"], by_type["Levels"]
    labels = [one["label"][0] for one in levels["info"]["desc"][0]["channels"][0]["channel"]]
    assert np.array_equal(events["time_stamps"], levels["time_stamps"])
    numbers = dict(zip(labels, np.asarray(levels["time_series"]).T, strict=True))
    return [text for (text,) in events["time_series"]], numbers, np.asarray(levels["time_stamps"]), by_type


def stored(path: Path):
    """The store's intervals and responses, by run, trial and interval."""
    tables = schema.run.join(schema.trial).join(schema.interval)
    intervals = select(schema.interval, schema.trial.c.run_id, schema.trial.c.number, schema.trial.c.rig_tick)
    responses = select(schema.response, schema.trial.c.run_id, schema.trial.c.number)
    with closing(Store(path, must_exist=True)) as store, store.read() as connection:
        rows = connection.execute(intervals.select_from(tables)).all()
        answers = connection.execute(responses.select_from(schema.response.join(schema.trial))).all()
    return (
        {(row.run_id, row.number, row.position): row for row in rows},
        {(row.run_id, row.number): row for row in answers},
    )


def key(numbers, at: int, *names: str):
    return tuple(int(numbers[name][at]) for name in names)


def compare(path: Path, store: Path) -> tuple[np.ndarray, np.ndarray]:
    """Hold levels and answers against the store; return the onsets' times by the rig's clock as stored, and stamps."""
    events, numbers, stamps, _ = read(path)
    intervals, answers = stored(store)
    onsets = [at for at, event in enumerate(events) if event.startswith("onset/")]
    given = [at for at, event in enumerate(events) if event.startswith("answer/")]
    assert len(onsets) + len(given) == len(events)
    assert [key(numbers, at, "run", "trial", "interval") for at in onsets] == list(intervals)
    assert [key(numbers, at, "run", "trial") for at in given] == list(answers)
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
    (tmp_path / "protocol.toml").write_text(ONE)
    heard = on_this_machine(tmp_path, f"SessionID = {uuid.uuid4().hex}")
    command = ["-m", "tactuator", "experiment", "observe", "protocol.toml", "--store", "lab.db", "--lsl"]
    with recorded(tmp_path / "all.xdf", "tactuator simulated", heard):
        subprocess.run(
            [sys.executable, *command], cwd=tmp_path, env=os.environ | heard, check=True, stderr=-3, stdout=-3
        )
    rig_s, stamps = compare(tmp_path / "all.xdf", tmp_path / "lab.db")
    assert rig_s.size > 80
    assert np.abs((stamps - stamps[0]) - (rig_s - rig_s[0])).max() < 1.0 / controller().rate_hz


SPEED = 4.0


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """The folder of a session at a rig that keeps time, recorded; when each trial began and each onset was told."""
    folder, name = tmp_path_factory.mktemp("paced"), f"paced {uuid.uuid4().hex}"
    rig = SimulatedRig(controller().display)
    rig.load(controller())
    paced, clock, seen = PacedRig(rig, SPEED), SystemClock(), []
    with closing(Outlet(paced, name, "a display")) as streams, closing(Store(folder / "lab.db")) as store:
        place = Apparatus(paced, controller(), name, streams)
        study = open_study(store, DetectionTask(parse_protocol(ONE), place), ONE, clock, token)
        with recorded(folder / "all.xdf", f"tactuator {name}", on_this_machine(folder)):
            streams.wait_for_recorder()
            at = PresentedSession(open_session(study, "S1"))
            at.session.give_consent()
            for _ in range(6):
                began_s, told_s = clock.monotonic_s(), []
                trial = at.present(lambda interval, begins: told_s.append(clock.monotonic_s())).trial  # noqa: B023
                seen.append((began_s, told_s[::2]))
                at.answer(Answer(trial.responses[0], clock.utc(), received_s=clock.monotonic_s()))
    return folder, seen


def test_outlet__of_a_rig_that_keeps_time__has_onsets_between_the_trials_beginning_and_their_lamps(session) -> None:
    folder, seen = session
    rig_s, stamps = compare(folder / "all.xdf", folder / "lab.db")
    assert stamps.size == 6 * 3
    for (began_s, told_s), onsets_s, stored_s in zip(seen, stamps.reshape(6, 3), rig_s.reshape(6, 3), strict=True):
        assert began_s < onsets_s[0]
        assert (onsets_s <= told_s).all()
        drift_s = SPEED * (onsets_s - onsets_s[0]) - (stored_s - stored_s[0])
        assert np.abs(drift_s).max() < 1.0 / controller().rate_hz


def test_outlet__in_an_xdf_file__is_described(session) -> None:
    *_, by_type = read(session[0] / "all.xdf")
    for kind, (form, units) in {"Markers": ("string", {"event": ""}), "Levels": ("double64", UNITS)}.items():
        about = by_type[kind]["info"]
        described = about["desc"][0]["channels"][0]["channel"]
        assert {one["label"][0]: one["unit"][0] or "" for one in described} == units
        assert (about["channel_format"][0], float(about["nominal_srate"][0])) == (form, 0.0)
        assert about["desc"][0]["acquisition"][0]["model"] == ["a display"]


def test_outlet__without_pylsl__says_what_installs_it(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pylsl", None)
    with pytest.raises(BadInput, match=r"pylsl is missing; allowed: install it with `pip install tactuator\[lsl\]`"):
        Outlet(SimulatedRig(controller().display), "simulated", "a display")

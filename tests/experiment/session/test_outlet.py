"""Onsets, levels and answers as a recorder of Lab Streaming Layer on this machine gets them."""

import json
import os
import subprocess
import sys
import uuid
from contextlib import closing, contextmanager
from pathlib import Path
from xml.etree import ElementTree

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
from tests.experiment.session.apparatuses import PROTOCOL, controller, rows_of, token

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


def test_outlet__of_a_rig_that_keeps_time__has_onsets_between_the_trials_beginning_and_their_lamps(tmp_path) -> None:
    name, speed, seen = f"paced {uuid.uuid4().hex}", 4.0, []
    rig = SimulatedRig(controller().display)
    rig.load(controller())
    paced, clock = PacedRig(rig, speed), SystemClock()
    with closing(Outlet(paced, name, "a display")) as streams, closing(Store(tmp_path / "lab.db")) as store:
        place = Apparatus(paced, controller(), name, streams)
        study = open_study(store, DetectionTask(parse_protocol(ONE), place), ONE, clock, token)
        with recorded(tmp_path / "all.json", f"tactuator {name}", on_this_machine(tmp_path)):
            streams.wait_for_recorder()
            at = PresentedSession(open_session(study, "S1"))
            at.session.give_consent()
            for _ in range(6):
                began_s, told_s = clock.monotonic_s(), []
                trial = at.present(lambda interval, begins: told_s.append(clock.monotonic_s())).trial  # noqa: B023
                seen.append((began_s, told_s[::2]))
                at.answer(Answer(trial.responses[0], clock.utc(), received_s=clock.monotonic_s()))
    rig_s, stamps = compare(tmp_path / "all.json", tmp_path / "lab.db")
    assert stamps.size == 6 * 3
    for (began_s, told_s), onsets_s, stored_s in zip(seen, stamps.reshape(6, 3), rig_s.reshape(6, 3), strict=True):
        assert began_s < onsets_s[0]
        assert (onsets_s <= told_s).all()
        drift_s = speed * (onsets_s - onsets_s[0]) - (stored_s - stored_s[0])
        assert np.abs(drift_s).max() < 1.0 / controller().rate_hz
    *_, described = read(tmp_path / "all.json")
    for about, (form, units) in zip(described, (("string", {"event": ""}), ("double64", UNITS)), strict=True):
        assert {each.findtext("label"): each.findtext("unit") or "" for each in about.iter("channel")} == units
        assert (about.findtext("channel_format"), float(about.findtext("nominal_srate"))) == (form, 0.0)
        assert about.findtext("desc/acquisition/model") == "a display"


def test_outlet__without_pylsl__says_what_installs_it(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pylsl", None)
    with pytest.raises(BadInput, match=r"pylsl is missing; allowed: install it with `pip install tactuator\[lsl\]`"):
        Outlet(SimulatedRig(controller().display), "simulated", "a display")

"""The power goes at any moment, and what was not brought to the disk is there in part or not at all.

The witness is a library below SQLite that records what is asked of the disk. One record is cut a hundred times.
"""

import os
import shlex
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store
from tests.experiment.store.power.disk import Asked, after_cut, requests

pytestmark = pytest.mark.slow
HERE = Path(__file__).parent
CUTS = 100


@pytest.fixture(scope="module")
def recorder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("recorder") / "recorder.so"
    compiler = shlex.split(sysconfig.get_config_var("CC") or "cc")[0]
    command = [compiler, "-shared", "-fPIC", "-O1", "-Wall", "-Werror", HERE / "power/recorder.c", "-o", made]
    subprocess.run(command, check=True)
    return made


def recorded(recorder: Path, folder: Path, durable: str) -> list[Asked]:
    folder.mkdir()
    (folder / "lab").mkdir()
    log = folder / "log"
    told = {"LD_PRELOAD": str(recorder), "RECORDED_FOLDER": str(folder / "lab"), "RECORDED_LOG": str(log)}
    program = [sys.executable, "-m", "tests.experiment.store.power.answering", str(folder / "lab"), durable]
    subprocess.run(program, check=True, env={**os.environ, **told}, cwd=HERE.parents[2])
    return requests(log)


def lost_or_doubled(asked: list[Asked], folder: Path, share: float, rng: np.random.Generator) -> str:
    """What is wrong with the store after the cut; nothing where every acknowledged answer is in it once."""
    folder.mkdir()
    promised = {
        tuple(map(int, line.split()))
        for one in asked
        if one.path.name == "acknowledged.txt" and one.kind == "w"
        for line in one.content.decode().splitlines()
    }
    for name, content in after_cut(asked, share, rng).items():
        if name != "acknowledged.txt":
            (folder / name).write_bytes(content)
    if not promised and not (folder / "lab.db").exists():
        return ""
    try:
        store = Store(folder / "lab.db", must_exist=bool(promised))  # before its tables there is nothing to lose
    except BadInput as error:
        return str(error)
    columns = (schema.session.c.subject_id, schema.run.c.position, schema.trial.c.number)
    query = select(*columns).select_from(schema.response.join(schema.trial).join(schema.run).join(schema.session))
    with store.read() as connection:
        rows = [(row.subject_id - 1, row.position, row.number) for row in connection.execute(query)]
    store.close()
    if len(set(rows)) != len(rows):
        return "doubled"
    missing = promised - set(rows)
    return f"{len(missing)} of {len(promised)} lost" if missing else ""


def cut(asked: list[Asked], folder: Path, count: int) -> list[str]:
    rng, found = np.random.default_rng(13), []
    folder.mkdir()
    for index in range(count):
        moment, share = int(rng.integers(len(asked) + 1)), float(rng.choice([0.0, 0.3, 0.7, 1.0]))
        found.append(lost_or_doubled(asked[:moment], folder / str(index), share, rng))
    return found


def test_store__power_cut_at_a_hundred_moments__keeps_every_answer_once(recorder: Path, tmp_path) -> None:
    asked = recorded(recorder, tmp_path / "run", "durable")
    assert sum(one.path.name == "acknowledged.txt" and one.kind == "w" for one in asked) > 80
    assert {one.kind for one in asked} >= {"w", "s"}
    assert [one for one in cut(asked, tmp_path / "cuts", CUTS) if one] == []


def test_store__that_waits_for_no_disk__loses_answers_in_the_same_cuts(recorder: Path, tmp_path) -> None:
    asked = recorded(recorder, tmp_path / "run", "not")
    assert sum("lost" in one or "damaged" in one or "not there" in one for one in cut(asked, tmp_path / "cuts", 30)) > 5

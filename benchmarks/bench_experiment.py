"""Experiments: 10,000 runs of QUEST+ beside plain NumPy; thresholds of a store beside SQL and the refit alone.

The plain QUEST+ does all runs side by side in double precision, as one would write it: the posterior times the two
tables, no refit, no flags. The store is a study of two simulated people, copied until it holds the trials; its peer
scans all trials and intervals by `sqlite3` and fits all runs in one batch. An export's peer writes the same two files
straight from the cursor; thresholds, which the export has as well, are not in it. A store is opened beside a small one.
"""

from __future__ import annotations

import csv
import sqlite3
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from paper_loop import paper_controller, paper_display
from timing import in_turn, of_program

from tactuator.experiment.procedure.quest_plus import QuestPlus, Tables
from tactuator.experiment.procedure.refit import refit
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.session.task import Apparatus, SystemClock
from tactuator.experiment.simulated.quality import Setting, simulate
from tactuator.experiment.simulated.subjects import run_study, simulated_observers
from tactuator.experiment.store.store import Store
from tactuator.experiment.words import COLUMNS
from tactuator.perception.curve import curve
from tactuator.perception.psychometric import Psychometric, Weibull
from tactuator.rig.simulated import SimulatedRig

RUNS, TRIALS = 10_000, 1_000_000
PROTOCOL = """
[study]
name = "benchmark"
seed = 1
[procedure]
kind = "imece2004"
[conditions]
fingers = ["index"]
frequencies_hz = [8, 40, 200]
[[subject]]
code = "S1"
[[subject]]
code = "S2"
"""
KEYS = {
    "subject": {"id": "subject"},
    "session": {"id": "session", "subject_id": "subject"},
    "run": {"id": "run", "session_id": "session"},
    "trial": {"id": "trial", "run_id": "run"},
    "interval": {"id": "interval", "trial_id": "trial"},
    "response": {"trial_id": "trial"},
}
SCAN = """
select run.id, trial.level_db_sl, response.correct from run join trial on trial.run_id = run.id
join response on response.trial_id = trial.id where not run.practice order by run.id, trial.number
"""
INTERVALS = "select trial_id, stimulus, commanded_db_sl, measured_db_sl, saturated from interval order by id"


def plain_quest_plus(runs: int) -> float:
    """Return the rms error of as many runs of QUEST+, about truths that scatter by 5 dB."""
    rule, rng = QuestPlus(), np.random.default_rng(0)
    table, model = Tables(rule, 1.0 / 3.0), Psychometric(Weibull(2.5))
    errors = []
    for first in range(0, runs, 1000):
        truth = rng.normal(0.0, 5.0, min(1000, runs - first))
        posterior = np.tile(table.prior, (truth.size, 1))
        for _ in range(rule.trials):
            weighted = posterior * table.parameter_threshold
            chance, right = posterior @ table.psi, weighted @ table.psi
            wrong = weighted.sum(axis=1, keepdims=True) - right
            place = np.argmin(-(right**2) / chance - wrong**2 / (1.0 - chance), axis=1)
            correct = rng.random(truth.size) < model.probability(table.levels[place] - truth)
            psi = table.psi[:, place].T
            posterior = posterior * np.where(correct[:, None], psi, 1.0 - psi)
            posterior = posterior / posterior.sum(axis=1, keepdims=True)
        errors.append(posterior @ table.parameter_threshold - truth)
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def filled(path: Path, trials: int) -> int:
    """Make a store of about so many trials and return how many runs it has."""
    display = paper_display()
    rig, controller = SimulatedRig(display, seed=2), paper_controller(display)
    rig.load(controller)
    store = Store(path, durable=False)
    people = simulated_observers(curve("bolanowski-1988"), 2, seed=5)
    protocol = parse_protocol(PROTOCOL, Protocol)
    run_study(store, protocol, PROTOCOL, Apparatus(rig, controller, "simulated"), people, SystemClock())
    store.close()
    with sqlite3.connect(path) as connection:
        step = {name: connection.execute(f'select max(id) from "{name}"').fetchone()[0] for name in (*KEYS,)[:-1]}
        for copy in range(1, max(1, round(trials / step["trial"]))):
            for table, shifts in KEYS.items():
                _copy(connection, table, {key: copy * step[of] for key, of in shifts.items()}, copy, step)
        runs = int(connection.execute("select count(*) from run").fetchone()[0])
    connection.close()
    return runs


def _copy(connection: sqlite3.Connection, table: str, shifts: dict[str, int], copy: int, step: dict[str, int]) -> None:
    """Copy the first rows of a table, with the keys shifted and what must be unique made so."""
    own = {"code": f"code || '-{copy}'", "link_token": f"link_token || '-{copy}'"}
    if table == "subject":
        own["number"] = f"number + {copy * step['subject']}"
    names = [row[1] for row in connection.execute(f'pragma table_info("{table}")')]
    made = [f"{name} + {shifts[name]}" if name in shifts else own.get(name, f'"{name}"') for name in names]
    key = next(iter(shifts))
    last = step[table if table != "response" else "trial"]
    quoted = ", ".join(f'"{name}"' for name in names)
    connection.execute(
        f'insert into "{table}" ({quoted}) select {", ".join(made)} from "{table}" where {key} <= {last}'
    )


def bare_thresholds(path: Path) -> float:
    """Return the mean refit of every run of the store, by a scan and one batch."""
    connection = sqlite3.connect(path)
    run, level, correct = (np.array(column) for column in zip(*connection.execute(SCAN).fetchall(), strict=True))
    connection.execute(INTERVALS).fetchall()
    connection.close()
    first = np.flatnonzero(np.diff(run, prepend=-1))
    count = np.diff(first, append=run.size)
    rows, columns = np.repeat(np.arange(count.size), count), np.arange(run.size) - np.repeat(first, count)
    levels, outcomes = np.full((count.size, count.max()), np.nan), np.zeros((count.size, count.max()), dtype=bool)
    levels[rows, columns], outcomes[rows, columns] = level, correct.astype(bool)
    return float(refit(levels, outcomes).threshold_db.mean())


def plain_export(path: Path, folder: Path) -> None:
    """Write trials and intervals of the store as they come from the cursor."""
    source = """from study join subject on subject.study_id = study.id join session on session.subject_id = subject.id
    join run on run.session_id = session.id join trial on trial.run_id = run.id
    join response on response.trial_id = trial.id
    left join protocol_version on run.protocol_version_id = protocol_version.id"""
    of_intervals = f'{source} join "interval" on "interval".trial_id = trial.id'
    connection = sqlite3.connect(path)
    for table, rows, last in (("trials", source, ""), ("intervals", of_intervals, ', "interval".position')):
        names = ", ".join(column.source for column in COLUMNS[table])
        cursor = connection.execute(f"select {names} {rows} order by run.id, trial.number{last}")
        with (folder / f"{table}.csv").open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(cursor)
    connection.close()


def opened(path: Path) -> None:
    Store(path, must_exist=True).close()


def large_store(path: Path, small: Path) -> dict[str, object]:
    """Return what export and opening of a store take, beside their peers."""
    program, folder = [sys.executable, "-m", "tactuator", "experiment"], path.parent / "plain"
    folder.mkdir()
    command = [*program, "export", "--store", str(path), "--out", str(path.parent / "out")]
    own_s, _, peak_mb = of_program(command)
    plain_s, _, _ = of_program(own_process(f"b.plain_export(b.Path({str(path)!r}), b.Path({str(folder)!r}))"))
    opened_s = in_turn({str(place): partial(opened, place) for place in (path, small)})
    return {
        "export_s": own_s, "cursor_to_file_s": plain_s, "over_peer": own_s / plain_s, "peak_mb": peak_mb,
        "opening_s": opened_s[str(path)], "opening_small_s": opened_s[str(small)], "goals": {"peak_mb": 300.0},
    }  # fmt: skip


def own_process(work: str) -> list[str]:
    """Return the command that does a work of this module in a process of its own."""
    folder = str(Path(__file__).resolve().parent)
    return [sys.executable, "-c", f"import sys; sys.path.insert(0, {folder!r}); import bench_experiment as b; {work}"]


def run() -> dict[str, object]:
    spent = in_turn({"own": lambda: simulate(QuestPlus(), Setting(RUNS)), "plain": lambda: plain_quest_plus(RUNS)}, 2)
    _, _, memory_mb = of_program(own_process(f"b.simulate(b.QuestPlus(), b.Setting({RUNS}))"))
    figures: dict[str, object] = {
        "quest_plus": {
            "own_s": spent["own"],
            "plain_numpy_s": spent["plain"],
            "over_plain": spent["own"] / spent["plain"],
            "peak_mb": memory_mb,
            "goals": {"seconds": 3.0, "peak_mb": 250.0},
        }
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "store.db"
        runs = filled(path, TRIALS)
        command = [sys.executable, "-m", "tactuator", "experiment", "thresholds", "--store", str(path), "--json"]
        bare = own_process(f"b.bare_thresholds(b.Path({str(path)!r}))")
        turns = [(of_program(command), of_program(bare)) for _ in range(2)]
        own_s, bare_s = (min(turn[which][0] for turn in turns) for which in (0, 1))
        figures["thresholds"] = {
            "trials": TRIALS,
            "runs": runs,
            "own_s": own_s,
            "sql_and_refit_s": bare_s,
            "over_peer": own_s / bare_s,
            "peak_mb": turns[0][0][2],
            "goals": {"seconds": 15.0, "peak_mb": 300.0},
        }
        small = Path(folder) / "small.db"
        filled(small, 1000)
        figures["large_store"] = large_store(path, small)
    return figures

"""Stores merged into one: rows of every table, results of each, and stores that do not go together."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest

import tactuator as tt
from tactuator.api.experiment import merge, void
from tactuator.errors import BadInput, StoreFault
from tactuator.experiment.store import schema
from tactuator.io.controller import write_controller

PROTOCOL = """
[study]
name = "two booths"
seed = {seed}
[procedure]
kind = "imece2004"
[conditions]
fingers = ["index"]
frequencies_hz = [20.0, 50.0, 100.0]
[[subject]]
code = "S1"
group = "{group}"
"""
EVERY = [table.name for table in schema.tables.sorted_tables if table is not schema.schema_version]


@pytest.fixture(scope="module")
def booths(tmp_path_factory: pytest.TempPathFactory, controller) -> list[Path]:
    """The stores of two booths, with one protocol but for its seed; a run of the second is void."""
    folder = tmp_path_factory.mktemp("booths")
    write_controller(place := folder / "controller.json", controller)
    stores = []
    for seed, group in enumerate(("left", "right"), start=1):
        protocol = folder / f"{group}.toml"
        protocol.write_text(PROTOCOL.format(seed=seed, group=group), encoding="utf-8")
        stores.append(folder / f"{group}.db")
        rig = tt.SimulatedRig(controller.display, seed)
        tt.observe(protocol, stores[-1], rig, controller=place, seed=seed)
    void("S1", stores[1], "a knock", run=2)
    return stores


def rows(store: Path, table: str) -> list[dict[str, object]]:
    with sqlite3.connect(store) as connection:
        connection.row_factory = sqlite3.Row
        return [dict(row) for row in connection.execute(f"SELECT * FROM {table} ORDER BY rowid")]


def unnumbered(row: dict[str, object]) -> dict[str, object]:
    return {name: value for name, value in row.items() if name != "id" and not name.endswith("_id")}


def test_merge__of_two_stores__holds_every_row_of_both(booths, tmp_path) -> None:
    merged = merge(booths, tmp_path / "all.db").out
    for table in EVERY:
        separate = [unnumbered(row) for store in booths for row in rows(store, table)]
        assert [unnumbered(row) for row in rows(merged, table)] == separate, table
    with sqlite3.connect(merged) as connection:
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
    assert len(rows(merged, "void")) == 1


def test_merge__thresholds__are_those_of_each_store(booths, tmp_path) -> None:
    merged = tt.thresholds(merge(booths, tmp_path / "all.db").out).results.thresholds
    separate = [each for store in booths for each in tt.thresholds(store).results.thresholds]
    assert len(separate) == 5
    np.testing.assert_array_equal([each.refit_db_sl for each in merged], [each.refit_db_sl for each in separate])


def test_merge__subject_group__belongs_to_its_own_trials(booths, tmp_path) -> None:
    merged = merge(booths, tmp_path / "all.db").out
    with sqlite3.connect(merged) as connection:
        query = "SELECT subject_group, count(*) FROM response JOIN trial ON trial.id = trial_id "
        query += "JOIN run ON run.id = run_id JOIN session ON session.id = session_id "
        query += "JOIN subject ON subject.id = session.subject_id GROUP BY subject_group"
        counted = dict(connection.execute(query))
    assert counted == {store.stem: len(rows(store, "response")) for store in booths}


def test_merge__what_does_not_go_together__is_refused_and_nothing_written(booths, tmp_path) -> None:
    out = tmp_path / "all.db"
    with pytest.raises(BadInput, match="1 of its visits"):
        merge([booths[0], booths[1], booths[0]], out)
    (tmp_path / "text.db").write_text("no store")
    with pytest.raises((BadInput, StoreFault), match=r"text\.db"):
        merge([booths[0], tmp_path / "text.db"], out)
    assert [path.name for path in tmp_path.iterdir()] == ["text.db"]
    out.write_text("something")
    with pytest.raises(BadInput, match="exists"):
        merge(booths, out)
    assert out.read_text() == "something"

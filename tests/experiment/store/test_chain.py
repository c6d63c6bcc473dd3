"""The chain over a store's rows: what was altered by plain SQL is found, and copies are whole or refused."""

import hashlib
import json
import random
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from tactuator.errors import BadInput
from tactuator.experiment.store.merge import Shared
from tactuator.experiment.store.store import Store, opened_store
from tactuator.verbs.store import backup, verify
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, begin


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    """A store of one session: a run that is over, another that goes on, and events."""
    path, clock = tmp_path_factory.mktemp("chain") / "lab.db", ObedientClock()
    with opened_store(path) as store:
        begin(store, clock, trials=20).session.end_break()
        begin(store, clock, trials=5)
    return path


def altered(path: Path, rng: random.Random) -> str:
    """Alter the file by plain SQL: a value, a row away, two rows exchanged. The table."""
    with closing(sqlite3.connect(path)) as plain, plain:
        names = [name for (name,) in plain.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        counts = {name: plain.execute(f"SELECT count(*) FROM {name}").fetchone()[0] for name in names}
        table = rng.choice([name for name in names if counts[name] > (name == "schema_version")])
        names = [row[1] for row in plain.execute(f"PRAGMA table_info({table})")]
        key = names[0]
        rows = [row[0] for row in plain.execute(f"SELECT {key} FROM {table} ORDER BY {key}")]
        row = rng.choice(rows)
        kind = rng.choice(["edit", "edit", "delete", "swap"])
        if kind == "delete" and row != rows[-1] and table != "chain":
            plain.execute(f"DELETE FROM {table} WHERE {key} = ?", (row,))
        elif kind == "swap" and len(rows) > 1:
            other = rng.choice([each for each in rows if each != row])
            for old, new in ((row, -1), (other, row), (-1, other)):
                plain.execute(f"UPDATE {table} SET {key} = ? WHERE {key} = ?", (new, old))
        else:
            _edit(plain, table, key, row, rng.choice(names[1:]), rng)
    return table


def _edit(plain, table, key, row, column, rng) -> None:
    (old,) = plain.execute(f"SELECT {column} FROM {table} WHERE {key} = ?", (row,)).fetchone()
    if isinstance(old, float):
        new = old + rng.choice([1e-12, 0.5, -6.0]) if abs(old) < 1 else old * rng.choice([1 + 1e-12, 2.0])
    elif isinstance(old, int):
        new = old + rng.choice([300, 700, 1000])  # beyond the numbers that are taken
    else:
        new = f"{old or ''}{rng.choice(['1', ' ', '0'])}" if old is None or len(old) < 2 else old[1:] + old[0] + "z"
    plain.execute("PRAGMA ignore_check_constraints = 1")
    plain.execute(f"UPDATE {table} SET {column} = ? WHERE {key} = ?", (new, row))


def test_verify__as_it_was_written__holds(sound) -> None:
    result = verify(sound)
    assert (result.holds, result.altered) == (True, ()), result.altered
    assert result.rows > 25 * 4
    assert verify(sound, result.head).holds
    for head in ("12", "12:", "x:12", ":"):
        with pytest.raises(BadInput, match="NUMBER:SHA256"):
            verify(sound, head)
    with pytest.raises(BadInput, match="the store itself"):
        backup(sound, sound)
    with closing(sqlite3.connect(sound)) as plain:
        assert {who for (who,) in plain.execute("SELECT who FROM event")} == {"subject S1"}


@pytest.fixture(scope="module")
def stations(tmp_path_factory) -> Path:
    """The store of a station that shares a study: it remembers how far the shared store was merged."""
    folder, clock = tmp_path_factory.mktemp("shared"), ObedientClock()
    for name, subject in (("one", 0), ("two", 1)):
        with opened_store(folder / f"{name}.db") as store, closing(Shared(store, str(folder / "all.db"))) as shared:
            presented = begin(store, clock, PROTOCOL, subject)
            for _ in range(4):
                answer_one(presented, clock)
                shared.exchange()
    return folder / "two.db"


def test_exchange__that_has_nothing_to_bring__writes_nothing(stations, tmp_path) -> None:
    """Where another store's chain stands leaves a link, which must not make the other store write in its turn."""
    paths = [Path(shutil.copy(stations.with_name(name), tmp_path / name)) for name in ("two.db", "all.db")]
    heads = []
    with closing(Store(paths[0])) as store, closing(Shared(store, str(paths[1]))) as shared:
        for _ in range(4):
            assert shared.exchange().rows == 0
            heads.append([verify(path).head for path in paths])
    assert heads[1:] == heads[:1] * 3


@pytest.mark.parametrize("of", ["sound", "stations"])
@pytest.mark.parametrize("count", [15, pytest.param(1000, marks=pytest.mark.soak)])
def test_verify__rows_altered_at_random__are_found_in_every_copy(request, tmp_path, of, count) -> None:
    tables, sound = set(), request.getfixturevalue(of)
    for seed in range(count):
        copy = Path(shutil.copy(sound, tmp_path / "copy.db"))
        tables.add(altered(copy, random.Random(seed)))
        assert not verify(copy).holds, f"alteration {seed}"
    assert len(tables) > 5


@pytest.mark.parametrize(
    ("statement", "first"),
    [
        ("UPDATE response SET correct = 1 - correct WHERE trial_id = 9", ("response", 9, "changed")),
        ("DELETE FROM response WHERE trial_id = 9", ("response", 9, "taken away")),
        (
            "INSERT INTO event (id, at_utc, who, kind, detail) VALUES (99, '2026', '', 'note', '')",
            ("event", 99, "put in"),
        ),
        ("UPDATE response SET correct = 2 WHERE trial_id = 9 AND correct", ("response", 9, "changed")),
        ("UPDATE chain SET content_sha256 = sha256 WHERE id = 30", ("chain", 30, "changed")),
        ("DELETE FROM chain WHERE id = 30", ("chain", 30, "taken away")),
        ("UPDATE trial SET level_db_sl = level_db_sl + 4 WHERE id > 6", ("trial", 7, "changed")),
    ],
)
def test_verify__altered_row__is_told_as_the_first(sound, tmp_path, statement, first) -> None:
    copy = Path(shutil.copy(sound, tmp_path / "copy.db"))
    with closing(sqlite3.connect(copy)) as plain, plain:
        assert plain.execute(statement).rowcount
    told = verify(copy).altered[0]
    assert (told.table, told.row, told.what) == first


def test_verify__end_cut_off_with_its_links__is_found_by_the_head_that_was_kept(sound, tmp_path) -> None:
    copy, kept = Path(shutil.copy(sound, tmp_path / "copy.db")), verify(sound).head
    with closing(sqlite3.connect(copy)) as plain, plain:
        plain.execute("DELETE FROM response WHERE trial_id = 25")
        plain.execute("DELETE FROM interval WHERE trial_id = 25")
        plain.execute("DELETE FROM trial WHERE id = 25")
        plain.execute("DELETE FROM chain WHERE of_table IN ('trial', 'response') AND of_row = 25")
        plain.execute("DELETE FROM chain WHERE id > (SELECT max(id) FROM chain WHERE of_table = 'response')")
    assert verify(copy).holds
    assert [each.what for each in verify(copy, kept).altered] == ["taken away"]


def test_chain__by_the_words_of_the_page__is_what_another_program_computes(sound) -> None:
    """docs/files.md says how: an independent reading of it, with sqlite3 and json alone."""

    def sha256(content) -> str:
        return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()

    def rows(cursor):
        return [dict(zip([column[0] for column in cursor.description], row, strict=True)) for row in cursor]

    with closing(sqlite3.connect(sound)) as plain:
        (previous,) = plain.execute("SELECT uid FROM schema_version").fetchone()
        truths = {"practice", "rig_simulated", "saturated", "correct"}
        links = rows(plain.execute("SELECT * FROM chain ORDER BY id"))
        last = {(link["of_table"], link["of_row"]): link["content_sha256"] for link in links}
        for number, link in enumerate(links, 1):
            parts = (link["of_table"], link["of_row"], link["content_sha256"], link["origin"])
            assert link["id"] == number
            assert link["sha256"] == sha256([previous, number, *parts])
            previous = link["sha256"]
        for table in ("study", "run", "trial", "interval", "response", "event", "session"):
            for row in rows(plain.execute(f"SELECT * FROM {table}")):
                values = {n: bool(v) if n in truths and v is not None else v for n, v in row.items()}
                assert last[table, row.get("id", row.get("trial_id"))] == sha256(values)


WRITER = """
import sys
from tactuator.experiment.store.store import opened_store, sessions_of
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, begin
clock = ObedientClock()
with sessions_of(sys.argv[1]), opened_store(__import__("pathlib").Path(sys.argv[1])) as store:
    presented = begin(store, clock, PROTOCOL.replace("[conditions]", "[conditions]\\nrepeats = 500"))
    while True:
        if presented.session.stage == "break":
            clock.wait(300.0)
            presented.session.end_break()
        answer_one(presented, clock)
        print(presented.session.trials, flush=True)
"""


@pytest.mark.parametrize("count", [3, pytest.param(100, marks=pytest.mark.soak)])
def test_backup__of_a_store_that_is_written_to__is_whole_every_time(tmp_path, count) -> None:
    path = tmp_path / "lab.db"
    writer = subprocess.Popen([sys.executable, "-c", WRITER, path], stdin=-1, stdout=-1, text=True)
    try:
        for _ in range(count):
            before = int(writer.stdout.readline())
            result = backup(path, tmp_path / "copy.db")
            assert result.holds
            with closing(Store(tmp_path / "copy.db", must_exist=True)) as copy, copy.read() as connection:
                stored = connection.exec_driver_sql("SELECT count(*) FROM response").scalar_one()
            assert stored >= before
        alone = Path(shutil.copy(path, tmp_path / "alone.db"))
        with pytest.raises(BadInput, match=r"alone.db was copied.*alone.db-wal is not beside it; it holds \d+ answers"):
            Store(alone, must_exist=True)
        assert backup(alone, tmp_path / "mended.db").holds
        Store(tmp_path / "mended.db", must_exist=True).close()
    finally:
        writer.kill()
        writer.communicate()
    with closing(Store(path, must_exist=True)):  # its program was killed: nothing lacks
        pass
    assert not Path(f"{path}-wal").exists()
    Store(path, must_exist=True).close()

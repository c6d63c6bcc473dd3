"""The store's file: made, refused."""

import errno
import os
import sqlite3
import subprocess
import sys

import pytest
from sqlalchemy import inspect

from tactuator.errors import BadInput
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store, opened_store, sessions_of
from tests.experiment.session.apparatuses import ObedientClock, answer_one, begin, opened_study


@pytest.mark.parametrize(("durable", "waits"), [(True, 2), (False, 0)])
def test_store__new__has_the_latest_schema_in_wal_mode_and_waits_for_the_disk_or_not(tmp_path, durable, waits) -> None:
    store = Store(tmp_path / "lab.db", durable=durable)
    assert set(inspect(store.engine).get_table_names()) == set(schema.tables.tables)
    with store.read() as connection:
        asked = ("journal_mode", "synchronous", "foreign_keys")
        found = [connection.exec_driver_sql(f"PRAGMA {name}").scalar_one() for name in asked]
    assert found == ["wal", waits, 1]
    store.close()


@pytest.mark.parametrize("version", [schema.VERSION - 1, schema.VERSION + 1])
def test_store__of_another_version__is_refused(tmp_path, version) -> None:
    store = Store(tmp_path / "lab.db")
    with store.begin() as connection:
        connection.exec_driver_sql(f"UPDATE schema_version SET version = {version}")
    store.close()
    with pytest.raises(BadInput, match=f"version {version}"):
        Store(tmp_path / "lab.db")


def test_store__another_programs_database__is_refused(tmp_path) -> None:
    other = sqlite3.connect(tmp_path / "other.db")
    other.execute("CREATE TABLE cats (name TEXT)")
    other.close()
    with pytest.raises(BadInput, match="cats"):
        Store(tmp_path / "other.db")


def test_store__not_a_database__is_refused(tmp_path) -> None:
    path = tmp_path / "lab.db"
    path.write_text("trial,response\n" * 500)
    with pytest.raises(BadInput, match="not a database"):
        Store(path)


def test_store__damaged__is_refused(tmp_path) -> None:
    path = tmp_path / "lab.db"
    store = Store(path)
    with store.begin() as connection:
        for number in range(300):
            connection.exec_driver_sql(
                "INSERT INTO event (at_utc, who, kind, detail) VALUES ('2026', '', 'note', ?)", (f"{number}" * 40,)
            )
    store.close()
    content = bytearray(path.read_bytes())
    for offset in range(4096 * 24, len(content), 512):
        content[offset : offset + 64] = b"\xff" * 64
    path.write_bytes(bytes(content))
    with pytest.raises(BadInput, match=r"damaged|malformed"):
        Store(path)


def test_store__damaged_where_sqlite_quotes_it__is_refused(tmp_path) -> None:
    # SQLite's message holds the bytes, which are no text
    path = tmp_path / "lab.db"
    Store(path).close()
    content = path.read_bytes()
    assert b"CREATE TABLE event" in content
    path.write_bytes(content.replace(b"CREATE TABLE event", b"CREATE TABL\xcc event"))
    with pytest.raises(BadInput, match="allowed: a sound SQLite database"):
        Store(path)


@pytest.mark.parametrize("name", ["nowhere/lab.db", "lab.db"])
def test_store__must_exist_and_does_not__is_refused(tmp_path, name) -> None:
    with pytest.raises(BadInput, match="is not there"):
        Store(tmp_path / name, must_exist=True)
    assert list(tmp_path.iterdir()) == []


def test_store__folder_missing__is_refused(tmp_path) -> None:
    with pytest.raises(BadInput, match="folder"):
        Store(tmp_path / "nowhere" / "lab.db")


def test_close__ctrl_c_within_the_library__leaves_the_word_to_the_program(tmp_path, monkeypatch, caplog) -> None:
    """SQLAlchemy logged it with a traceback, beside the program's one line."""
    store = Store(tmp_path / "lab.db")
    sound = store.engine.dialect.do_close

    def interrupted(connection) -> None:
        sound(connection)
        raise KeyboardInterrupt

    monkeypatch.setattr(store.engine.dialect, "do_close", interrupted)
    with pytest.raises(KeyboardInterrupt):
        store.close()
    assert not caplog.records


def test_lock__second_holder__is_refused_in_one_line_and_let_in_after(tmp_path) -> None:
    store = tmp_path / "lab.db"
    with sessions_of(store):
        with pytest.raises(
            BadInput, match=rf"lab.db: its sessions are run by process {os.getpid()} on .*one at a time"
        ):
            sessions_of(store).__enter__()
        with sessions_of(tmp_path / "other.db"):
            pass
    with sessions_of(store):
        pass


def test_lock__holder_killed__is_free(tmp_path) -> None:
    store = tmp_path / "lab.db"
    held = subprocess.Popen(
        [sys.executable, "-c", f"from tactuator.experiment.store.store import sessions_of\n"
         f"with sessions_of({str(store)!r}): print('held', flush=True); input()"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert held.stdout.readline() == "held\n"
    with pytest.raises(BadInput, match=f"process {held.pid}"):
        sessions_of(store).__enter__()
    held.kill()
    held.communicate()
    with sessions_of(store):
        pass


def test_lock__disk_without_room_for_its_name__holds_and_leaves_nothing(tmp_path, monkeypatch):
    """Found on a full disk: the refusal named no file, and the lock stayed behind."""
    store = tmp_path / "lab.db"

    def full(*given):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    with sessions_of(store), pytest.raises(BadInput, match="run by another process"), sessions_of(store):
        pass
    assert list(tmp_path.iterdir()) == []


def left(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError, BadInput("no"), None])
def test_opened_store__no_study_was_begun__is_taken_away(tmp_path, error) -> None:
    def leave() -> None:
        with opened_store(tmp_path / "lab.db"):
            if error is not None:
                raise error

    if error is None:
        leave()
    else:
        with pytest.raises(type(error) if isinstance(error, BadInput) else error):
            leave()
    assert left(tmp_path) == []


def test_opened_store__interrupted_before_anybody_came__keeps_the_study_whose_links_are_given_out(tmp_path) -> None:
    with pytest.raises(KeyboardInterrupt), opened_store(tmp_path / "lab.db") as store:
        opened_study(store, ObedientClock())
        raise KeyboardInterrupt
    assert left(tmp_path) == ["lab.db"]


def test_opened_store__refused_after_an_answer__keeps_it(tmp_path, clock) -> None:
    with pytest.raises(BadInput), opened_store(tmp_path / "lab.db") as store:
        answer_one(begin(store, clock), clock)
        raise BadInput("no")
    assert left(tmp_path) == ["lab.db"]


def test_opened_store__was_there_before__is_left_as_it_is(tmp_path) -> None:
    (tmp_path / "lab.db").touch()
    with pytest.raises(BadInput), opened_store(tmp_path / "lab.db") as store:
        opened_study(store, ObedientClock())
        raise BadInput("no")
    assert left(tmp_path) == ["lab.db"]

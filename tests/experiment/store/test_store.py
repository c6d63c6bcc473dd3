"""The store's file: made, migrated, refused."""

import sqlite3

import pytest
from sqlalchemy import create_engine, inspect

from tactuator.errors import BadInput
from tactuator.experiment.store.migrations import STEPS, migrate, version
from tactuator.experiment.store.store import Store


def test_store__new__has_the_latest_schema_in_wal_mode(tmp_path) -> None:
    store = Store(tmp_path / "lab.db")
    assert version(store.engine) == len(STEPS)
    with store.read() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar_one() == "wal"
        assert connection.exec_driver_sql("PRAGMA synchronous").scalar_one() == 2
        assert connection.exec_driver_sql("PRAGMA foreign_keys").scalar_one() == 1
    store.close()


def test_store__of_the_first_version__is_brought_up_and_keeps_its_rows(tmp_path) -> None:
    engine = create_engine(f"sqlite:///{tmp_path / 'lab.db'}")
    assert migrate(engine, upto=1) == 0
    with engine.begin() as connection:
        connection.exec_driver_sql("INSERT INTO event (at_utc, kind, detail) VALUES ('2026', 'note', 'old')")
    assert "stimulus" not in inspect(engine).get_table_names()
    engine.dispose()
    store = Store(tmp_path / "lab.db")
    assert "stimulus" in inspect(store.engine).get_table_names()
    with store.read() as connection:
        assert connection.exec_driver_sql("SELECT detail FROM event").scalar_one() == "old"
    store.close()


def test_store__of_a_later_tool__is_refused(tmp_path) -> None:
    store = Store(tmp_path / "lab.db")
    with store.begin() as connection:
        connection.exec_driver_sql("UPDATE schema_version SET version = 99")
    store.close()
    with pytest.raises(BadInput, match="version 99"):
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
                "INSERT INTO event (at_utc, kind, detail) VALUES ('2026', 'note', ?)", (f"{number}" * 40,)
            )
    store.close()
    content = bytearray(path.read_bytes())
    for offset in range(4096 * 24, len(content), 512):
        content[offset : offset + 64] = b"\xff" * 64
    path.write_bytes(bytes(content))
    with pytest.raises(BadInput, match=r"damaged|malformed"):
        Store(path)


@pytest.mark.parametrize("name", ["nowhere/lab.db", "lab.db"])
def test_store__must_exist_and_does_not__is_refused(tmp_path, name) -> None:
    with pytest.raises(BadInput, match="is not there"):
        Store(tmp_path / name, must_exist=True)
    assert list(tmp_path.iterdir()) == []


def test_store__folder_missing__is_refused(tmp_path) -> None:
    with pytest.raises(BadInput, match="folder"):
        Store(tmp_path / "nowhere" / "lab.db")

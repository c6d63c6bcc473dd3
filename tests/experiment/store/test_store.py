"""The store's file, its lock and its copies; a database server."""

import errno
import os
import shutil
import socket
import sqlite3
import subprocess
import sys
import threading
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import delete, func, inspect, select

from tactuator.api.experiment import backup
from tactuator.errors import BadInput, StoreFault
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store, opened_store, sessions_of
from tests.experiment.session.apparatuses import answer_one, begin, opened_study


@pytest.mark.parametrize(("durable", "waits"), [(True, 2), (False, 0)])
def test_store__new__has_the_latest_schema_and_waits_for_the_disk_or_not(tmp_path, durable, waits) -> None:
    store = Store(tmp_path / "lab.db", durable=durable)
    assert set(inspect(store.engine).get_table_names()) == set(schema.tables.tables)
    with store.read() as connection:
        asked = ("journal_mode", "synchronous", "foreign_keys")
        found = [connection.exec_driver_sql(f"PRAGMA {name}").scalar_one() for name in asked]
    assert found == ["wal", waits, 1]
    store.close()


def test_store__that_is_not_there_of_something_else_or_damaged__is_refused(tmp_path) -> None:
    for name in ("nowhere/lab.db", "lab.db"):
        with pytest.raises(BadInput, match="is not there"):
            Store(tmp_path / name, must_exist=True)
    with pytest.raises(BadInput, match="folder"):
        Store(tmp_path / "nowhere" / "lab.db")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "text.db").write_text("trial,response\n" * 500)
    with pytest.raises(BadInput, match="not a database"):
        Store(tmp_path / "text.db")
    with closing(sqlite3.connect(tmp_path / "other.db")) as other:
        other.execute("CREATE TABLE cats (name TEXT)")
    with pytest.raises(BadInput, match="cats"):
        Store(tmp_path / "other.db")
    (tmp_path / "copy.db").touch()
    with pytest.raises(BadInput, match=r"holds no table; expected .*lacks its copy.db-wal"):
        Store(tmp_path / "copy.db", must_exist=True)
    for version in (schema.VERSION - 1, schema.VERSION + 1):
        Store(tmp_path / f"{version}.db").close()
        with closing(sqlite3.connect(tmp_path / f"{version}.db")) as plain, plain:
            plain.execute(f"UPDATE schema_version SET version = {version}")
        with pytest.raises(BadInput, match=f"version {version}"):
            Store(tmp_path / f"{version}.db")
    path = tmp_path / "lab.db"
    store = Store(path)
    with store.begin() as connection:
        for number in range(300):
            connection.exec_driver_sql(
                "INSERT INTO event (at_utc, who, kind, detail) VALUES ('2026', '', 'note', ?)", (f"{number}" * 40,)
            )
    store.close()
    sound = path.read_bytes()
    content = bytearray(sound)
    for offset in range(4096 * 24, len(content), 512):
        content[offset : offset + 64] = b"\xff" * 64
    path.write_bytes(bytes(content))
    with pytest.raises(BadInput, match=r"damaged|malformed"):
        Store(path)
    assert b"CREATE TABLE event" in sound
    path.write_bytes(sound.replace(b"CREATE TABLE event", b"CREATE TABL\xcc event"))
    with pytest.raises(BadInput, match="a sound SQLite database"):  # SQLite's message holds the bytes: no text
        Store(path)


_HOARD = "CREATE TRIGGER hoard BEFORE DELETE ON subject BEGIN SELECT RAISE(IGNORE); END"
_FLIP = "CREATE TRIGGER flip AFTER INSERT ON response BEGIN UPDATE response SET correct = 1; END"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ([_HOARD], "the triggers 'hoard'"),
        ([_HOARD, _FLIP], "the triggers 'hoard', 'flip'"),
        (["ALTER TABLE run DROP COLUMN shown"], "lacks shown in the table run"),
        (["DROP TABLE void"], "in the table void"),
        (["ALTER TABLE trial RENAME TO old", "CREATE VIEW trial AS SELECT * FROM old"], "in the table trial"),
        (["DELETE FROM schema_version"], "schema version none"),
        ([f"INSERT INTO schema_version VALUES ({schema.VERSION})"], f"version {schema.VERSION}, {schema.VERSION}"),
    ],
)
def test_store__that_acts_by_itself_or_lacks_a_part__is_refused(tmp_path, changes, words) -> None:
    """A trigger kept a subject who was to be erased, of whom the program then said that all was."""
    path = tmp_path / "lab.db"
    Store(path).close()
    with closing(sqlite3.connect(path)) as plain, plain:
        for change in changes:
            plain.execute(change)
    with pytest.raises(BadInput, match=words):
        Store(path)


def test_store__with_a_view_and_a_table_of_the_laboratorys_own__is_opened(tmp_path) -> None:
    path = tmp_path / "lab.db"
    Store(path).close()
    with closing(sqlite3.connect(path)) as plain, plain:
        plain.execute("CREATE VIEW right_ones AS SELECT * FROM response WHERE correct")
        plain.execute("CREATE TABLE remarks (text TEXT)")
    Store(path).close()


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


def test_lock__second_holder__is_refused_until_the_first_has_ended(tmp_path, monkeypatch) -> None:
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
        with pytest.raises(
            BadInput, match=rf"lab.db: its sessions are run by process {os.getpid()} on .*one at a time"
        ):
            sessions_of(store).__enter__()
        with sessions_of(tmp_path / "other.db"):
            pass
    with sessions_of(store):
        pass
    store = tmp_path / "lab.db"

    def full(*given):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    with sessions_of(store), pytest.raises(BadInput, match="run by another process"), sessions_of(store):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("error", "before"),
    [
        *((error, "nothing") for error in (KeyboardInterrupt, RuntimeError, BadInput)),
        (BadInput, "a store"),
        (KeyboardInterrupt, "a study"),  # its links are given out
        (BadInput, "an answer"),
    ],
)
def test_opened_store__that_ends_with_an_error__is_taken_away_if_unused(tmp_path, clock, error, before):
    path = tmp_path / "lab.db"
    if before == "a store":
        path.touch()
    with pytest.raises(error), opened_store(path) as store:
        if before in ("a store", "a study"):
            opened_study(store, clock)
        if before == "an answer":
            answer_one(begin(store, clock), clock)
        raise error("no")
    assert [each.name for each in tmp_path.iterdir()] == ["lab.db"] * (before != "nothing")
    with opened_store(tmp_path / "other.db"):
        pass
    assert not (tmp_path / "other.db").exists()


WRITER = """
import sys
from tactuator.experiment.store.store import opened_store, sessions_of
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, begin
clock = ObedientClock()
with sessions_of(sys.argv[1]), opened_store(__import__("pathlib").Path(sys.argv[1])) as store:
    presented = begin(store, clock, PROTOCOL.replace("[conditions]", "[conditions]\\nrepeats = 500"))
    while True:
        if presented.stage == "break":
            clock.wait(300.0)
            presented.end_break()
        answer_one(presented, clock)
        print(presented.trials, flush=True)
"""


@pytest.mark.parametrize("count", [3, pytest.param(100, marks=pytest.mark.soak)])
def test_backup__of_a_store_that_is_written_to__is_whole_every_time(tmp_path, count) -> None:
    path = tmp_path / "lab.db"
    writer = subprocess.Popen([sys.executable, "-c", WRITER, path], stdin=-1, stdout=-1, text=True)
    try:
        for k in range(count):
            before = int(writer.stdout.readline())
            assert backup(path, tmp_path / f"copy{k}.db").answers >= before
        alone = Path(shutil.copy(path, tmp_path / "alone.db"))
        with pytest.raises(BadInput, match=r"alone.db was copied.*alone.db-wal is not beside it; it holds \d+ answers"):
            Store(alone, must_exist=True)
        assert backup(alone, tmp_path / "mended.db").answers <= backup(path, tmp_path / "copy.db").answers
        Store(tmp_path / "mended.db", must_exist=True).close()
    finally:
        writer.kill()
        writer.communicate()
    with closing(Store(path, must_exist=True)):  # its program was killed: nothing lacks
        pass
    assert not Path(f"{path}-wal").exists()
    Store(path, must_exist=True).close()
    for there in (path, tmp_path / "copy.db"):
        before = there.read_bytes()
        with pytest.raises(BadInput, match="is the store of an experiment already; expected another name"):
            backup(path, there)
        assert there.read_bytes() == before


@pytest.mark.parametrize("answer", [b"+OK ready\r\n", b"\0\0\0\x34\0\3\0\0"])
def test_server__that_is_none__is_refused_in_one_line(answer: bytes) -> None:
    with pytest.raises(BadInput, match="a PostgreSQL database that is there and lets one in"):
        Store("postgresql://lab@127.0.0.1:9/nothing")
    with socket.create_server(("127.0.0.1", 0)) as other:

        def speak() -> None:
            talking, _ = other.accept()
            with talking:
                talking.sendall(answer)
                while talking.recv(999):  # as long as it is listened to
                    pass

        speaking = threading.Thread(target=speak)
        speaking.start()
        with pytest.raises(BadInput, match="is no PostgreSQL server; expected "):
            Store(f"postgresql://lab@127.0.0.1:{other.getsockname()[1]}/study")
        speaking.join()


def torn_copy(tmp_path, writer):
    writer.stdout.readline()
    return Path(shutil.copy(tmp_path / "lab.db", tmp_path / "alone.db"))


def test_copy__without_its_log__is_refused_while_another_program_has_it_open_and_afterwards(tmp_path) -> None:
    path = tmp_path / "lab.db"
    writer = subprocess.Popen([sys.executable, "-c", WRITER, path], stdin=-1, stdout=-1, text=True)
    try:
        alone = torn_copy(tmp_path, writer)
        with closing(sqlite3.connect(alone)) as other:
            other.execute("CREATE TABLE note (text)")
            other.commit()
            assert Path(f"{alone}-wal").stat().st_size
            for _ in range(2):
                with pytest.raises(BadInput, match=r"alone.db was copied"):
                    Store(alone, must_exist=True)
        for _ in range(2):
            with pytest.raises(BadInput, match=r"alone.db was copied"):
                Store(alone, must_exist=True)
        Store(path, must_exist=True).close()
    finally:
        writer.kill()
        writer.communicate()
    for name in ("lab.db", "lab.db-wal"):
        shutil.copy(tmp_path / name, tmp_path / name.replace("lab", "both"))
    old_log = Path(f"{path}-wal").read_bytes()
    Store(tmp_path / "both.db", must_exist=True).close()
    Store(tmp_path / "both.db", must_exist=True).close()
    backup(path, tmp_path / "whole.db")
    (tmp_path / "whole.db-wal").write_bytes(old_log)
    content = (tmp_path / "whole.db").read_bytes()
    with pytest.raises(
        BadInput, match=r"whole.db-wal beside it is of another file or program; .*whole.db-wal .* moved elsewhere"
    ):
        Store(tmp_path / "whole.db", must_exist=True)
    assert (tmp_path / "whole.db").read_bytes() == content


@pytest.fixture(scope="module")
def killed(tmp_path_factory) -> Path:
    """A store whose program was killed while it wrote."""
    path = tmp_path_factory.mktemp("killed") / "old.db"
    with subprocess.Popen([sys.executable, "-c", WRITER, path], stdin=-1, stdout=-1, text=True) as writer:
        for _ in range(5):
            writer.stdout.readline()
        writer.kill()
    return path


@pytest.mark.parametrize("copied", ["closed", "written to", "of yesterday"])
def test_copy__beside_the_log_of_another_store__is_refused_and_stays_as_it_was(tmp_path, clock, killed, copied) -> None:
    old, path = Path(shutil.copy(killed, tmp_path)), tmp_path / "lab.db"
    shutil.copy(f"{killed}-wal", tmp_path)
    log = Path(f"{old}-wal").read_bytes()
    of = old if copied == "of yesterday" else path
    with opened_store(of) as store:
        if of == path:
            answer_one(begin(store, clock), clock)
        else:
            with store.begin() as connection:
                connection.execute(delete(schema.response))
        if copied == "written to":
            shutil.copy(of, tmp_path / "copy.db")
    if copied != "written to":
        shutil.copy(of, tmp_path / "copy.db")
    (tmp_path / "copy.db-wal").write_bytes(log)
    content = (tmp_path / "copy.db").read_bytes()
    for reads in (lambda: Store(tmp_path / "copy.db", must_exist=True), lambda: backup(tmp_path / "copy.db", path)):
        with pytest.raises(BadInput, match=r"copy.db-wal beside it is of another file.*copy.db-wal .* moved elsewhere"):
            reads()
    assert (tmp_path / "copy.db").read_bytes() == content
    Path(tmp_path / "copy.db-wal").unlink()


def test_opened_store__reader_that_keeps_the_mark_out_of_the_file__is_refused(tmp_path, clock) -> None:
    path = tmp_path / "lab.db"
    with opened_store(path) as store:
        opened_study(store, clock)
    with closing(sqlite3.connect(path)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM study").fetchone()
        with pytest.raises(StoreFault, match="cannot be marked"), opened_store(path):
            pass
    with opened_store(path):
        pass


def test_open_store__opened_and_closed_again_by_the_same_program__keeps_its_log(tmp_path, clock) -> None:
    path = tmp_path / "lab.db"
    with opened_store(path) as store:
        session = begin(store, clock)
        Store(path, must_exist=True).close()
        reads = "import sqlite3, sys; c = sqlite3.connect(sys.argv[1]); c.execute('SELECT * FROM study'); c.close()"
        subprocess.run([sys.executable, "-c", reads, path], check=True)  # the last one to close takes the log away
        assert Path(f"{path}-wal").exists()
        answer_one(session, clock)
        with closing(sqlite3.connect(path)) as other:
            assert other.execute("SELECT count(*) FROM response").fetchone() == (1,)


@pytest.mark.parametrize("end", ["", "-wal", "-shm"])
@pytest.mark.parametrize("planted", ["hard link", "pipe"])
def test_store__of_two_names_or_beside_a_planted_log__is_refused_and_the_other_file_stays(
    tmp_path, clock, end, planted
) -> None:
    path, other = tmp_path / "lab.db", tmp_path / "other"
    with opened_store(path) as store:
        opened_study(store, clock)
    file = Path(f"{path}{end}")
    file.rename(other) if end == "" else other.write_bytes(b"precious")
    content = other.read_bytes()
    os.mkfifo(file) if planted == "pipe" else file.hardlink_to(other)
    with pytest.raises(BadInput, match=rf"{file.name} is a link"):
        Store(path)
    assert other.read_bytes() == content
    file.unlink()
    if end == "":
        other.rename(path)
    Store(path, must_exist=True).close()


@pytest.mark.parametrize("planted", ["link", "hard link", "pipe"])
def test_lock__planted_link__is_refused_and_its_target_stays(tmp_path, planted) -> None:
    target = tmp_path / "target"
    target.write_text("precious")
    lock = tmp_path / "lab.db.lock"
    makes = {"link": lambda: lock.symlink_to(target), "hard link": lambda: os.link(target, lock)}
    makes.get(planted, lambda: os.mkfifo(lock))()
    with pytest.raises(BadInput, match=r"lab\.db\.lock"), sessions_of(tmp_path / "lab.db"):
        pass
    assert target.read_text() == "precious"


def test_store__on_a_medium_that_cannot_be_written__is_read_and_nothing_is_made_beside_it(tmp_path, monkeypatch, clock):
    path = tmp_path / "lab.db"
    with opened_store(path) as store:
        answer_one(begin(store, clock), clock)
    monkeypatch.setattr(os, "access", lambda path, mode: mode == os.R_OK)
    with closing(Store(path, must_exist=True)) as store, store.read() as connection:
        assert connection.execute(select(func.count()).select_from(schema.response)).scalar_one() == 1
        assert [each.name for each in tmp_path.iterdir()] == ["lab.db"]
        with pytest.raises(StoreFault, match="readonly"), store.begin() as writing:
            writing.execute(delete(schema.response))
    Path(f"{path}-wal").write_bytes(b"0" * 40)
    with pytest.raises(BadInput, match="has a log"):
        Store(path, must_exist=True)

"""The database of an experiment: SQLite in WAL mode, every commit on disk before it is acknowledged."""

from __future__ import annotations

import fcntl
import logging
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, Table, create_engine, event, exists, insert, inspect, select
from sqlalchemy.exc import DatabaseError, OperationalError

from tactuator.errors import BadInput, StoreFault
from tactuator.experiment.store import schema
from tactuator.io.kinds import require_kind


@contextmanager
def sessions_of(store: str | Path) -> Iterator[None]:
    """Hold the sessions of the store at that path for the length of the context.

    The lock is the operating system's, on a file beside the store, so that it ends with the process, however that ends.
    Raises BadInput, naming the process that has it, where another one runs the sessions.
    """
    path = Path(f"{store}.lock")
    if not path.parent.is_dir():
        raise BadInput(f"store {store}: its folder is not there", "a place in a folder that exists")
    handle = _locked(path, store)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)


def _locked(path: Path, store: str | Path) -> int:
    """Open and lock the file at the path; one that its last holder removed meanwhile is opened anew."""
    while True:
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise BadInput(f"store {store}: {path.name}: {error.strerror}", "a folder that can be written") from None
        try:
            _lock(handle, store)
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), path.stat()):
                    return handle
        except BadInput:
            os.close(handle)
            raise
        os.close(handle)


def _lock(handle: int, store: str | Path) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        who = os.read(handle, 200).decode(errors="replace").strip() or "another process"
        raise BadInput(f"store {store}: its sessions are run by {who}", "one at a time") from None
    os.ftruncate(handle, 0)
    with suppress(OSError):  # a full disk: it is locked all the same, by "another process"
        os.pwrite(handle, f"process {os.getpid()} on {os.uname().nodename}\n".encode(), 0)


@contextmanager
def opened_store(path: Path) -> Iterator[Store]:
    """Yield the database at the path, open for the length of the context; it is made if it is not there.

    A database that was made here is taken away at the end if it holds no study, or if what was asked for was refused
    (BadInput) before anything was presented. Raises BadInput as `Store` does.
    """
    was_there = path.exists()
    store = Store(path)
    for_nothing = not was_there
    try:
        yield store
        for_nothing = for_nothing and not _holds(store, schema.study)
    except BadInput:
        for_nothing = for_nothing and not _holds(store, schema.run)
        raise
    except BaseException:
        for_nothing = for_nothing and not _holds(store, schema.study)
        raise
    finally:
        store.close()
        if for_nothing:
            for end in ("", "-wal", "-shm"):
                Path(f"{path}{end}").unlink(missing_ok=True)


def _holds(store: Store, table: Table) -> bool:
    with store.read() as connection:
        return bool(connection.execute(select(exists(select(table.c.id)))).scalar_one())


_BUSY_TIMEOUT_MS = 2000


class _Interrupts(logging.Filter):
    """Keeps out what the library logs, with a traceback, of a Ctrl-C on which it ends: the program tells of that."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether the record is of anything else."""
        return not (record.exc_info and isinstance(record.exc_info[1], KeyboardInterrupt))


logging.getLogger("sqlalchemy.pool.impl.QueuePool").addFilter(_Interrupts())

_DAMAGED = (DatabaseError, sqlite3.DatabaseError, UnicodeDecodeError)
"""What a damaged file raises; SQLite's own message can hold bytes of it that are no text."""


class Store:
    """The database at a path, which is made if it is not there (unless must_exist).

    durable: every commit waits until it is on disk; False is for what simulated people answer into a folder that is
    thrown away, where nobody's answer can be lost. Raises BadInput for a file that is not a sound database of this
    tool, or cannot be opened.
    """

    def __init__(self, path: str | Path, must_exist: bool = False, durable: bool = True) -> None:
        self.path = Path(path)
        if must_exist and not self.path.is_file():
            raise BadInput(f"store {path} is not there", "the file of an experiment's database")
        require_kind(self.path, "store")
        if not self.path.parent.is_dir():
            raise BadInput(f"store {path}: its folder is not there", "a place in a folder that exists")
        if not must_exist:
            with suppress(OSError):  # what keeps it from being made is told by SQLite
                os.close(os.open(self.path, os.O_CREAT | os.O_CLOEXEC, 0o600))
        self.engine: Engine = create_engine(f"sqlite:///{self.path}", connect_args={"check_same_thread": False})
        event.listen(self.engine, "connect", _prepare if durable else _prepare_throwaway)
        event.listen(self.engine, "begin", _begin)
        try:
            self._check()
            self._make_tables()
        except _DAMAGED as error:
            self.engine.dispose()
            raise BadInput(f"store {path}: {_reason(error)}", "a sound SQLite database") from None

    def _check(self) -> None:
        with self.engine.connect() as connection:
            outcome = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar_one()
        if outcome != "ok":
            reason = " ".join(str(outcome).split())
            raise BadInput(f"store {self.path} is damaged ({reason})", "a sound SQLite database")

    def _make_tables(self) -> None:
        """Make the tables in an empty database. Raises BadInput for one of another program, or of another version."""
        names = inspect(self.engine).get_table_names()
        if not names:
            with self.engine.begin() as connection:
                schema.tables.create_all(connection)
                connection.execute(insert(schema.schema_version).values(version=schema.VERSION))
        elif schema.schema_version.name not in names:
            raise BadInput(f"store holds the tables {', '.join(names)}", "one that tactuator made, or a new file")
        else:
            with self.engine.connect() as connection:
                version = connection.execute(select(schema.schema_version.c.version)).scalar_one()
            if version != schema.VERSION:
                raise BadInput(f"store has schema version {version}", f"{schema.VERSION}; another tactuator wrote it")

    @contextmanager
    def begin(self) -> Iterator[Connection]:
        """Begin a transaction, which is committed at the end of the context.

        Raises StoreFault where it cannot be; nothing of it is then in the store.
        """
        try:
            with self.engine.begin() as connection:
                yield connection
        except _DAMAGED as error:
            raise StoreFault(f"{self.path.name}: {_reason(error)}") from error

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """Open a view of the store that keeps nobody from writing. Raises StoreFault where it cannot be read."""
        try:
            with self.engine.connect().execution_options(read_only=True) as connection:
                yield connection
        except _DAMAGED as error:
            raise StoreFault(f"{self.path.name}: {_reason(error)}") from error

    def close(self) -> None:
        """Close the database and its file."""
        self.engine.dispose()


def _prepare(connection: Any, record: Any) -> None:
    connection.isolation_level = None  # transactions are begun in `_begin`, not by the driver's guess
    cursor = connection.cursor()
    cursor.execute(f"PRAGMA busy_timeout = {_BUSY_TIMEOUT_MS}")
    cursor.execute("PRAGMA journal_mode = WAL")
    cursor.execute("PRAGMA synchronous = FULL")
    cursor.execute("PRAGMA foreign_keys = ON")
    cursor.close()


def _prepare_throwaway(connection: Any, record: Any) -> None:
    _prepare(connection, record)
    connection.execute("PRAGMA synchronous = OFF")


def _begin(connection: Connection) -> None:
    read_only = connection.get_execution_options().get("read_only", False)
    connection.exec_driver_sql("BEGIN" if read_only else "BEGIN IMMEDIATE")


def _reason(error: BaseException) -> str:
    """Return the database's own message in one line."""
    original = error.orig if isinstance(error, DatabaseError | OperationalError) else error
    return " ".join(str(original).split())

"""The database of an experiment, SQLite or PostgreSQL: every commit is on disk before it is acknowledged."""

from __future__ import annotations

import fcntl
import importlib.util
import logging
import os
import sqlite3
import stat
import struct
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from importlib import import_module
from itertools import compress
from pathlib import Path
from typing import Any
from weakref import WeakSet

from sqlalchemy import Connection, Engine, Table, create_engine, event, exists, func, insert, inspect, select
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, IntegrityError

from tactuator.errors import BadInput, StoreFault
from tactuator.experiment.store import schema
from tactuator.experiment.trial import without_controls
from tactuator.io.atomic import atomic_path
from tactuator.io.kinds import require_kind


@contextmanager
def sessions_of(store: str | os.PathLike[str]) -> Iterator[None]:
    """Hold the sessions of the store at that path for the length of the context.

    The lock is the operating system's, on a file beside the store, so that it ends with the process, however that ends.
    Raises BadInput, naming the process that has it, where another one runs the sessions.
    """
    if is_server(store):
        yield  # stations share it: no trial can be stored twice
        return
    path = Path(f"{os.path.realpath(store)}.lock")
    if not path.parent.is_dir():
        raise BadInput(f"store {store}: its folder is not there", "a place in a folder that exists")
    handle = _locked(path, store)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)


def _locked(path: Path, store: str | os.PathLike[str]) -> int:
    """Open and lock the file at the path; one that its last holder removed meanwhile is opened anew."""
    while True:
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        except OSError as error:
            raise BadInput(f"store {store}: {path.name}: {error.strerror}", "a folder that can be written") from None
        try:
            status = os.fstat(handle)
            if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:  # what is written to it would land elsewhere
                raise BadInput(f"store {store}: {path.name} is a link or a device", "no file of that name")
            _lock(handle, store)
            with suppress(FileNotFoundError):
                if os.path.samestat(status, path.lstat()):
                    return handle
        except BadInput:
            os.close(handle)
            raise
        os.close(handle)


def _lock(handle: int, store: str | os.PathLike[str]) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        who = os.read(handle, 200).decode(errors="replace").strip() or "another process"
        raise BadInput(f"store {store}: its sessions are run by {who}", "one at a time") from None
    os.ftruncate(handle, 0)
    with suppress(OSError):  # a full disk: it is locked all the same, by "another process"
        os.pwrite(handle, f"process {os.getpid()} on {os.uname().nodename}\n".encode(), 0)


@contextmanager
def opened_store(place: str | os.PathLike[str], must_exist: bool = False) -> Iterator[Store]:
    """Yield the database at the place, open for the length of the context; it is made if it is not there.

    A database that was made here is taken away at the end if it holds no study, or if what was asked for was refused
    (BadInput) before anything was presented. For as long as it is open the file itself says so: a copy of it alone may
    lack what was answered last. Raises BadInput as `Store` does.
    """
    for_nothing = not is_server(place) and not Path(place).exists()
    store = Store(place, must_exist)
    try:
        store.mark(_WRITING)
        yield store
        for_nothing = for_nothing and not _holds(store, schema.study)
    except BadInput:
        for_nothing = for_nothing and not _holds(store, schema.run)
        raise
    except BaseException as error:
        for_nothing = for_nothing and not _holds(store, schema.study)
        if isinstance(error, KeyboardInterrupt) and not for_nothing:
            error.add_note(f"{place}")  # the command line says what was written until then
        raise
    finally:
        with suppress(StoreFault):
            store.mark(0)
        store.close()
        if for_nothing:
            for end in ("", "-wal", "-shm"):
                Path(f"{place}{end}").unlink(missing_ok=True)


_WRITING = 1
"""User version of a file that a program writes to, or wrote to when it was killed."""


def _holds(store: Store, table: Table) -> bool:
    with store.read() as connection:
        return bool(connection.execute(select(exists(select(table.c.id)))).scalar_one())


_BUSY_TIMEOUT_MS = 2000
_CHECKED_BYTES = 1 << 26
"""Size of a file up to which it is checked whole whenever it is opened, in half a second; a larger one is checked
by `experiment backup`."""
_HEADER_BYTES, _FORMAT_BYTE, _MARK = 100, 18, slice(60, 64)
"""Of SQLite's file: its header; in it the version of the format (2: with a log), and the user version."""
_LOG_HEADER_BYTES, _FRAME_HEADER_BYTES, _LOGS_MAX, _NUMBERS = 32, 24, 1 << 20, 1 << 31
_CHANGING = (slice(24, 28), _MARK, slice(92, 100))
"""What of a file's header a mark changes: a counter, itself, and the counter again with SQLite's version."""


def _number(log: bytes) -> int:
    """Return the number of a log (its first salt), as far as a user version can hold it."""
    return int.from_bytes(log[16:20], "big") % _NUMBERS


def _mark_of(header: bytes) -> int:
    return int.from_bytes(header[_MARK], "big")


_PRIVATE = 0o600


class _Told(logging.Filter):
    """Keeps out what the library logs, with a traceback, of a Ctrl-C on which it ends, and of connections to a server
    that are no more: the program reports that.
    """

    def filter(self, record: logging.LogRecord) -> bool:
        error = record.exc_info[1] if record.exc_info else None
        return not (isinstance(error, KeyboardInterrupt | OSError) or type(error).__module__.startswith("pg8000"))


logging.getLogger("sqlalchemy.pool.impl.QueuePool").addFilter(_Told())

_SOUND = {True: "a sound SQLite database", False: "a PostgreSQL database that is there and lets one in"}
_UNWRITABLE = ("SQLITE_FULL", "SQLITE_READONLY", "SQLITE_IOERR_WRITE", "SQLITE_IOERR_SHM")
_DAMAGED: tuple[type[Exception], ...] = (DBAPIError, sqlite3.DatabaseError, UnicodeDecodeError)
"""What a damaged file raises; SQLite's own message can hold bytes of it that are no text."""


def _refuse_controls(_connection: Any, _cursor: Any, _statement: str, given: Any, *_: Any) -> None:
    rows = given if isinstance(given, list) else [given]
    for value in (value for row in rows for value in (row.values() if isinstance(row, dict) else row)):
        if isinstance(value, str):
            without_controls(value)


class Store:
    """The database at a path, which is made if it is not there (unless must_exist).

    place: a path, or postgresql+pg8000://USER@HOST/DATABASE, whose password may be in the variable PGPASSWORD. durable:
    every commit waits until it is on disk; False is for what simulated people answer into a folder that is thrown away,
    where nobody's answer can be lost. whole: a damaged file, and a copy that may lack its last answers, is refused.
    voided: what is read from it for results and exports (`usable`) includes void visits, runs and trials.
    Raises BadInput for a file that is not a sound database of this tool, or cannot be opened, and for a server.
    """

    def __init__(
        self,
        place: str | os.PathLike[str],
        must_exist: bool = False,
        durable: bool = True,
        whole: bool = True,
        voided: bool = False,
    ) -> None:
        self._mode = ""
        self.voided, self.usable = voided, schema.USABLE[voided]
        self.is_file = not is_server(place)
        self.path = Path(place)
        self._log = Path(f"{os.path.realpath(place)}-wal")  # SQLite has it beside the file, whatever links to it
        if self.is_file and self._is_writable():
            self._refuse_links()
        self._inode = _inode(self.path) if self.is_file else None
        self._open_here = self._inode is not None and any(store._inode == self._inode for store in list(_OPEN))
        self._had_log = self.is_file and not self._open_here and self._log_belongs(_mark_of(self._header()))
        self._faults = _DAMAGED if self.is_file else _server_faults()
        self.engine: Engine = self._file(must_exist, durable) if self.is_file else _server(str(place))
        event.listen(self.engine, "before_cursor_execute", _refuse_controls)
        self.name = str(place) if self.is_file else self.engine.url.render_as_string()
        try:
            is_checked = whole and self.is_file and self.path.stat().st_size <= _CHECKED_BYTES
            if is_checked:
                self._check_pages()
            self._make_tables(must_exist)
            if is_checked:
                self._check_cells()
            if whole and self.is_file and not self._had_log and not self._open_here:
                mark = self._mark_seen()
                if mark and not self._log_belongs(mark):
                    raise self._torn()
        except self._faults as error:
            self.engine.dispose()
            if getattr(getattr(error, "orig", error), "sqlite_errorname", "").startswith(_UNWRITABLE):
                got = f"store {self.name}: cannot be written ({_reason(error)})"
                raise BadInput(got, "a place with room to write") from None
            if self.is_file and not self._open_here:
                require_kind(self.path, "store")
            raise BadInput(f"store {self.name}: {_reason(error)}", _SOUND[self.is_file]) from None
        except BadInput:
            self.engine.dispose()
            raise
        if self.is_file:
            self._inode = _inode(self.path)
            _OPEN.add(self)

    def _file(self, must_exist: bool, durable: bool) -> Engine:
        if must_exist and not self.path.is_file():
            raise BadInput(f"store {self.path} is not there", "the file of an experiment's database")
        if not self.path.parent.is_dir():
            raise BadInput(f"store {self.path}: its folder is not there", "a place in a folder that exists")
        if not self.path.exists():
            with suppress(OSError):  # SQLite reports why it cannot be made
                os.close(os.open(self.path, os.O_CREAT | os.O_CLOEXEC, _PRIVATE))
        if not self._is_writable():
            return self._read_only()
        if not self._open_here:  # else it was looked at when it was opened
            self._refuse_old_log()
        engine = create_engine(f"sqlite:///{self.path}", connect_args={"check_same_thread": False})
        event.listen(engine, "connect", _prepare if durable else _prepare_throwaway)
        event.listen(engine, "begin", _begin_in_file)
        return engine

    def _is_writable(self) -> bool:
        return os.access(self.path, os.W_OK) and os.access(self.path.parent, os.W_OK)

    def _refuse_links(self) -> None:
        """Refuse files of two names: SQLite finds a log by the store's, and what it writes would land elsewhere."""
        store = Path(os.path.realpath(self.path))
        for path in (store, self._log, Path(f"{store}-shm")):
            with suppress(FileNotFoundError):
                status = path.lstat()
                if stat.S_ISDIR(status.st_mode):
                    continue
                if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
                    got = f"store {self.path}: {path.name} is a link, or a file of two names (a hard link), or a device"
                    raise BadInput(got, "a file of one name: the other removed, or a copy")

    def _read_only(self) -> Engine:
        """Return an engine that makes no file beside the store, as SQLite does otherwise for its log."""
        if self._log_size():
            got = f"store {self.path} cannot be written and has a log, {self._log.name}"
            raise BadInput(got, "both copied to a folder that can be written")
        self._mode = "?mode=ro&immutable=1"
        engine = create_engine(
            f"sqlite:///{self.path.resolve().as_uri()}{self._mode}&uri=true", connect_args={"check_same_thread": False}
        )
        event.listen(engine, "connect", _prepare_read_only)
        event.listen(engine, "begin", _begin_in_file)
        return engine

    def _log_size(self) -> int:
        return self._log.stat().st_size if self._log.exists() else 0

    def _header(self) -> bytes:
        """Return the header that the file itself has, whatever its log says; empty for one that is not there."""
        with suppress(OSError), self.path.open("rb") as file:
            return file.read(_HEADER_BYTES)
        return b""

    def _refuse_old_log(self) -> None:
        """Refuse a file that was put beside the log of another: SQLite would write that log over it, or read both."""
        header = self._header()
        restored, mark = header[_FORMAT_BYTE : _FORMAT_BYTE + 1] == b"\1", _mark_of(header)
        with suppress(OSError):
            own = not restored and (self._log_belongs(mark) if mark > _WRITING else not self._log_adds())
            if self._log_size() and not own:
                got = f"store {self.path} was copied: {self._log.name} beside it is of another file or program"
                moved = f"{self._log.name} and {self.path.name}-shm moved elsewhere (they may hold another's answers)"
                raise BadInput(got, f"the file alone, {moved}, and no other program that writes")

    def _log_adds(self) -> bool:
        """Return whether the log has a committed page that differs from the file's in more than the mark.

        A store that is not marked was closed, and its log with it. One that was killed while it was made has no page
        but the first.
        """
        with self._log.open("rb") as log, self.path.open("rb") as file:
            begins = log.read(_LOG_HEADER_BYTES)
            size, salts = int.from_bytes(begins[8:12], "big"), begins[16:24]
            if len(begins) < _LOG_HEADER_BYTES or self.path.stat().st_size <= size:
                return False
            committed, since = dict[int, bytes](), dict[int, bytes]()
            while (frame := log.read(_FRAME_HEADER_BYTES + size))[8:16] == salts and len(frame) > size:
                since[int.from_bytes(frame[:4], "big")] = frame[_FRAME_HEADER_BYTES:]
                if any(frame[4:8]):
                    committed |= since
                    since.clear()
            for page, content in committed.items():
                file.seek((page - 1) * size)
                there, here = bytearray(content), bytearray(file.read(size))
                for changing in _CHANGING if page == 1 else ():
                    there[changing] = here[changing]
                if there != here:
                    return True
        return False

    def _log_belongs(self, mark: int) -> bool:
        """Return whether the log beside the file is the one that a mark of the file names, if it names one.

        Another program that opens a copy makes a log, too. Every log begins with a number, which SQLite draws for the
        first and counts up for those that follow; the mark is the number of the first.
        """
        try:
            begins = self._log_begins()
        except OSError:
            return False
        if mark <= _WRITING:
            return True
        return len(begins) == _LOG_HEADER_BYTES and (_number(begins) - mark) % _NUMBERS < _LOGS_MAX

    def _log_begins(self) -> bytes:
        with self._log.open("rb") as log:
            return log.read(_LOG_HEADER_BYTES)

    def _check_pages(self) -> None:
        with self.engine.connect() as connection:
            outcome = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar_one()
        if outcome != "ok":
            raise self._damaged(" ".join(str(outcome).split()))

    def _check_cells(self) -> None:
        """Refuse values of another type than their column's, and rows of something that is not there."""
        with self.engine.connect() as connection:
            for table in schema.tables.sorted_tables:
                rows, *wrong = connection.execute(schema.misfits(table)).one()
                if rows:
                    names = " and ".join(compress(table.columns.keys(), wrong))
                    raise self._damaged(f"values of another type in {table}.{names}; rows: {rows}")
            stray = connection.exec_driver_sql("PRAGMA foreign_key_check").first()
        if stray:
            raise self._damaged(f"row {stray.rowid} of {stray.table} is of a {stray.parent} that is not there")

    def _damaged(self, reason: str) -> BadInput:
        return BadInput(f"store {self.path} is damaged ({reason})", "a sound SQLite database")

    def _mark_seen(self) -> int:
        with self.engine.connect() as connection:
            return int(connection.exec_driver_sql("PRAGMA user_version").scalar_one())

    def mark(self, mark: int) -> None:
        """Write a mark, and what was committed so far, into the file itself. Raises StoreFault where it cannot."""
        if self.is_file:
            with self._faults_told():
                self._mark(mark)

    def _mark(self, mark: int) -> None:
        with closing(sqlite3.connect(self.path, timeout=_BUSY_TIMEOUT_MS / 1000)) as plain:
            plain.execute("PRAGMA wal_checkpoint(PASSIVE)")  # a file without the mark lacks nothing of its log
            plain.execute(f"PRAGMA user_version = {mark}")
            if mark and self._log_size() >= _LOG_HEADER_BYTES:  # of the log that this was just written to
                plain.execute(f"PRAGMA user_version = {max(_number(self._log_begins()), _WRITING)}")
                (busy, *_) = plain.execute("PRAGMA wal_checkpoint(FULL)").fetchone()
                if busy:  # without its mark in the file, the log of a program that is killed would be another's
                    raise StoreFault(f"{self.path.name} cannot be marked: another program reads the store; close it")
            else:
                plain.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def compact(self) -> None:
        """Rewrite the file, so that nothing that was deleted is left in it or in its log. Raises StoreFault where
        another program reads the store: the log keeps it until that program ends.
        """
        if not self.is_file:
            return
        with self._faults_told(), closing(sqlite3.connect(self.path, timeout=_BUSY_TIMEOUT_MS / 1000)) as plain:
            plain.execute("PRAGMA secure_delete = ON")
            plain.execute("VACUUM")
            (busy, *_) = plain.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        if busy:
            raise StoreFault(f"{self._log.name} cannot be emptied: another program reads the store; close it")

    def _torn(self) -> BadInput:
        query = select(func.count(), func.max(schema.response.c.server_received_utc)).select_from(schema.response)
        with self.engine.connect() as connection:
            answers, last = connection.execute(query).one()
        there = f"it holds {answers} answers" + (f", the last of {last}" if last else "")
        return BadInput(
            f"store {self.path} was copied, or closed by another program, while it was written to: {self._log.name} is "
            f"not beside it; {there}, and may lack later ones",
            f"the file with its {self._log.name}, or what `experiment backup` makes of either",
        )

    def backup(self, out: Path) -> int:
        """Write a whole copy of the store, as it is at one moment, even while others write to it.

        Raises BadInput where a file is there, or the place cannot be written.
        """
        if not self.is_file:
            raise BadInput(f"store {self.name}", "a file; `pg_dump` copies a server's")
        with self._faults_told():
            self._check_cells()
        with (
            self._faults_told(),
            atomic_path(out, "store") as beside,
            closing(sqlite3.connect(f"{self.path.resolve().as_uri()}{self._mode}", uri=True)) as source,
            closing(sqlite3.connect(beside)) as copy,
        ):
            source.backup(copy)
            copy.execute("PRAGMA journal_mode = DELETE")
            copy.execute("PRAGMA user_version = 0")
            (answers,) = copy.execute("SELECT count(*) FROM response").fetchone()
            (outcome,) = copy.execute("PRAGMA quick_check(1)").fetchone()
            if outcome != "ok":
                raise self._damaged(outcome)
        return int(answers)

    def _make_tables(self, must_exist: bool) -> None:
        """Make the tables in an empty database. Raises BadInput for one of another program, or of another version."""
        with self.engine.connect() as connection:
            names = inspect(connection).get_table_names()
        if not names and must_exist and self.is_file:
            lacks = f"a store, or a copy made by `experiment backup`: one of a served store lacks its {self._log.name}"
            raise BadInput(f"store {self.path} holds no table", lacks)
        if not names:
            if self.is_file:
                self._mark(_WRITING)  # the file names the log with the tables before it has some of them
            with self._writing() as connection:
                if not inspect(connection).get_table_names():  # another process may have been first
                    schema.tables.create_all(connection)
                    connection.execute(insert(schema.schema_version).values(version=schema.VERSION))
            if self.is_file:
                self._mark(0)
        elif schema.schema_version.name not in names:
            raise BadInput(f"store holds the tables {', '.join(names)}", "one that tactuator made, or a new file")
        else:
            with self.engine.connect() as connection:
                versions = connection.execute(select(schema.schema_version.c.version)).scalars().all()
                if versions != [schema.VERSION]:
                    got = f"store has schema version {', '.join(map(str, versions)) or 'none'}"
                    raise BadInput(got, f"{schema.VERSION}; another tactuator wrote it")
                self._require_own_form(connection)

    def _require_own_form(self, connection: Connection) -> None:
        """Refuse a store that lacks a column, or whose file acts by itself: a trigger may alter what is answered, or
        keep what is erased. A view in the place of a table is none.
        """
        made = {name: columns for (_, name), columns in inspect(connection).get_multi_columns().items()}
        for name, table in schema.tables.tables.items():
            if lacks := set(table.columns.keys()) - {column["name"] for column in made.get(name, ())}:
                raise BadInput(f"store lacks {', '.join(sorted(lacks))} in the table {name}", "one that tactuator made")
        query = "SELECT name FROM sqlite_master WHERE type = 'trigger'"
        if self.is_file and (triggers := connection.exec_driver_sql(query).scalars().all()):
            got = f"store has the triggers {', '.join(map(repr, triggers))}"
            raise BadInput(got, "a store without (DROP TRIGGER), once its answers are looked through")

    @contextmanager
    def _writing(self) -> Iterator[Connection]:
        with self.engine.connect().execution_options(writes=True) as connection, connection.begin():
            yield connection

    @contextmanager
    def _faults_told(self) -> Iterator[None]:
        try:
            yield
        except self._faults as error:
            taken = isinstance(error, IntegrityError) and not self.is_file
            reason = "another station has gone on with this visit; open its page again" if taken else _reason(error)
            raise StoreFault(f"{self.path.name if self.is_file else self.name}: {reason}") from error

    @contextmanager
    def begin(self) -> Iterator[Connection]:
        """Begin a transaction, which is committed at the end of the context.

        Raises StoreFault where it cannot be; nothing of it is then in the store.
        """
        with self._faults_told(), self._writing() as connection:
            yield connection

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """Open a view of the store that keeps nobody from writing. Raises StoreFault where it cannot be read."""
        with self._faults_told(), self.engine.connect() as connection:
            yield connection

    def close(self) -> None:
        """Close the database and its file; the mark of a program that was killed goes with what SQLite kept of it."""
        with suppress(BadInput, StoreFault):
            if self._had_log and self._mark_seen():
                with sessions_of(self.path):  # refused while a program writes
                    self.mark(0)
        self.engine.dispose()
        _OPEN.discard(self)


_OPEN: WeakSet[Store] = WeakSet()
"""Stores that are open in this process: nothing but SQLite opens their files. Closing a file frees the locks that
the process has on it, SQLite's too, and another program that closes the store then takes its log away."""


def _inode(path: Path) -> tuple[int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def is_server(place: str | os.PathLike[str]) -> bool:
    """Return whether a place of a store is a database's server."""
    return str(place).startswith(_SERVER)


_SERVER = ("postgresql://", "postgresql+pg8000://")
_SERVER_TIMEOUT_S = 10.0
_LOCK = 0x7461637475
"""Number of the advisory lock that one writer at a time holds, so that subjects get different numbers."""


def _server(place: str) -> Engine:
    """Return the engine of a PostgreSQL server's database; its connections are tried before they are used."""
    try:
        url = make_url(place).set(drivername="postgresql+pg8000")
    except (ArgumentError, ValueError):
        raise BadInput("store postgresql+pg8000://...", "postgresql+pg8000://USER@HOST:PORT/DATABASE") from None
    if url.password is None and "PGPASSWORD" in os.environ:
        url = url.set(password=os.environ["PGPASSWORD"])
    engine = create_engine(url, pool_pre_ping=True, connect_args={"timeout": _SERVER_TIMEOUT_S})
    event.listen(engine, "begin", _begin_at_server)
    event.listen(engine, "do_connect", _connect_to_server)
    return engine


def _connect_to_server(dialect: Any, _: Any, arguments: Any, options: Any) -> Any:
    """Connect. The library looks up in its tables whatever answers: another program, or itself at its own port."""
    try:
        return dialect.connect(*arguments, **options)
    except (LookupError, ValueError, struct.error):
        raise OSError("what answers there is no PostgreSQL server") from None


def _server_faults() -> tuple[type[Exception], ...]:
    """Return what a server that is gone raises: much of it passes the library by."""
    if importlib.util.find_spec("pg8000") is None:
        raise BadInput("the package pg8000 is not installed: pip install 'tactuator[stations]'")
    return (*_DAMAGED, OSError, import_module("pg8000.exceptions").Error)


def _begin_at_server(connection: Connection) -> None:
    if connection.get_execution_options().get("writes", False):
        connection.execute(select(func.pg_advisory_xact_lock(_LOCK)))
    else:
        connection.exec_driver_sql("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ READ ONLY")


def _prepare(connection: Any, record: Any) -> None:
    connection.isolation_level = None  # transactions are begun in `_begin`, not by the driver's guess
    cursor = connection.cursor()
    cursor.execute(f"PRAGMA busy_timeout = {_BUSY_TIMEOUT_MS}")
    cursor.execute("PRAGMA journal_mode = WAL")
    cursor.execute("PRAGMA synchronous = FULL")
    cursor.execute("PRAGMA foreign_keys = ON")
    cursor.execute("PRAGMA secure_delete = ON")
    cursor.close()


def _prepare_read_only(connection: Any, record: Any) -> None:
    connection.isolation_level = None


def _prepare_throwaway(connection: Any, record: Any) -> None:
    _prepare(connection, record)
    connection.execute("PRAGMA synchronous = OFF")


def _begin_in_file(connection: Connection) -> None:
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _reason(error: BaseException) -> str:
    original = error.orig if isinstance(error, DBAPIError) else error
    return " ".join(str(original).split())

"""A PostgreSQL server of the tests' own: in a temporary folder, on the loopback address, not run by root."""

import os
import shutil
import socket
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import pg8000.dbapi

BIN = Path("/usr/lib/postgresql/15/bin")
UNPRIVILEGED: dict[str, Any] = {} if os.geteuid() else {"user": "postgres", "group": "postgres", "extra_groups": []}


class PostgresServer:
    """A server that may be killed and started again; what was committed is there again after that."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="tact-pg-", dir="/tmp"))
        if UNPRIVILEGED:
            shutil.chown(self.folder, "postgres", "postgres")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self._process: Any = None
        form = ["-A", "trust", "-U", "lab", "-E", "UTF8", "--locale=C", "--no-sync"]
        self._run([BIN / "initdb", "-D", self.folder / "data", *form]).wait()
        self.start()

    def _run(self, command: list[Any]) -> Any:
        with (self.folder.parent / f"{self.folder.name}.log").open("ab") as log:
            return subprocess.Popen(command, cwd="/", stdout=log, stderr=log, **UNPRIVILEGED)

    def start(self) -> None:
        options = {"listen_addresses": "127.0.0.1", "unix_socket_directories": self.folder, "max_connections": 200}
        # a killed process loses nothing that the kernel has: fsync guards against a cut of power
        options |= {"fsync": "off", "shared_buffers": "16MB"}
        settings = [part for name, value in options.items() for part in ("-c", f"{name}={value}")]
        end = time.monotonic() + 60.0
        while time.monotonic() < end:
            if self._process is None or self._process.poll() is not None:  # children of a killed one were still there
                self._process = self._run(
                    [BIN / "postgres", "-D", self.folder / "data", "-p", str(self.port), *settings]
                )
            try:
                self._connected("postgres").close()
                return
            except pg8000.dbapi.Error:
                time.sleep(0.05)
        raise AssertionError("PostgreSQL does not start")

    def _connected(self, database: str) -> Any:
        return pg8000.dbapi.connect("lab", host="127.0.0.1", port=self.port, database=database, timeout=5)

    def database(self, name: str) -> str:
        connection = self._connected("postgres")
        connection.autocommit = True
        connection.cursor().execute(f"CREATE DATABASE {name}")
        connection.close()
        return f"postgresql://lab@127.0.0.1:{self.port}/{name}"

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        time.sleep(0.1)
        shutil.rmtree(self.folder, ignore_errors=True)
        (self.folder.parent / f"{self.folder.name}.log").unlink(missing_ok=True)

"""The address of a server: where it listens, the names that it answers to, and the certificate that encrypts."""

from __future__ import annotations

import socket
import ssl
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from uvicorn import Config

from tactuator.errors import BadInput
from tactuator.web.listener import listener
from tactuator.web.serving import server_config

_LOOPBACK = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True)
class Address:
    """Address of a server, with the names that it answers to.

    names: host names that it answers to beside this machine's own, such as a proxy's. certificate, key: files in PEM
    form, for a connection that is encrypted (TLS); the key may be in the certificate's file. Raises BadInput where they
    do not belong together, cannot be read, or the key has a password.
    """

    host: str = "127.0.0.1"
    port: int = 0
    names: tuple[str, ...] = ()
    certificate: Path | None = None
    key: Path | None = None

    def __post_init__(self) -> None:
        if self.certificate is None:
            if self.key is not None:
                raise BadInput("a TLS key without a certificate", "both, or a certificate with its key")
            return
        for file in (self.certificate, self.key):
            if file is not None and file.is_fifo() and file.parent != Path("/dev/fd"):
                raise BadInput(f"TLS file {file} is a pipe", "a file in PEM form")
        try:
            # without a password of ours OpenSSL would ask at the terminal
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(self.certificate, self.key, password="")
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, FileNotFoundError) else "they are no pair without a password"
            files = f"{self.certificate}" if self.key is None else f"{self.certificate} and {self.key}"
            raise BadInput(f"TLS files {files}: {reason}", "a certificate and its key in PEM form") from None

    def listen(self) -> socket.socket:
        """Return the socket that listens there. Raises BadInput where that cannot be."""
        return listener(self.host, self.port)

    def config(self, app: FastAPI, clock: Callable[[], float]) -> Config:
        """Return the configuration of a server of the application there. clock: monotonic, seconds."""
        more: dict[str, Any] = {"host": self.host, "port": self.port}
        if self.certificate is not None:
            more |= {"ssl_certfile": self.certificate, "ssl_keyfile": self.key}
        return server_config(app, clock, (self.host, *self.names), **more)

    def base_url(self, listening: socket.socket) -> str:
        """Return the beginning of every address of the server that listens at the socket."""
        scheme = "http" if self.certificate is None else "https"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{scheme}://{host}:{listening.getsockname()[1]}"

    @property
    def warning(self) -> str:
        """Return what whoever opens the server to others has to know; empty on the loopback address."""
        if self.host in _LOOPBACK:
            return ""
        open_to = "anyone who can reach this machine can reach these pages"
        return open_to if self.certificate else f"{open_to}; the connection is not encrypted"

"""The command `console`: the page of the chain, served to this machine."""

import secrets
import sys
import webbrowser
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing, contextmanager
from multiprocessing import get_context
from pathlib import Path
from threading import Thread
from typing import Annotated

from tactuator.api.option import Argument, Option
from tactuator.api.parameters import AllowedHosts, Host, Place, Seed, TlsCertificate, TlsKey
from tactuator.console.page_server import ConsoleServer, build_console
from tactuator.console.rig_process import RigProcess
from tactuator.console.state import FILE, ConsoleState
from tactuator.errors import BadInput
from tactuator.processors import begin_helper
from tactuator.web.server import Address, run_server

_TOKEN_BYTES = 16
_CLOSING_S = 2.0
_NICER = 5
"""Niceness of the process that computes figures: the processor is for the frames of a drag."""


def console(
    display: Annotated[Place | None, Argument("Display file (TOML); without one: the examples.", file=True)] = None,
    rig: Annotated[str | None, Option("Rig of the scope: simulated, in-process, board:URL, sound:DEVICE.")] = None,
    seed: Seed = 0,
    host: Host = "127.0.0.1",
    port: Annotated[int, Option("Port; 0: any that is free.")] = 8770,
    allowed_host: AllowedHosts = None,
    tls_certificate: TlsCertificate = None,
    tls_key: TlsKey = None,
    open_browser: Annotated[bool, Option("Open the page in the browser.", ("--open",))] = False,
) -> None:
    """Serve a page to shape a loop, and to drive a rig. Runs until interrupted; the address of the page goes to
    standard error.
    """
    if rig is not None and display is None:
        raise BadInput("a rig without a display", "`tactuator console DISPLAY.toml --rig simulated`")
    certificate, key = (None if place is None else Path(place) for place in (tls_certificate, tls_key))
    address = Address(host, port, tuple(allowed_host or ()), certificate, key)
    # a program that is cut off leaves its semaphores to the tracker of them, which deletes them without a word then
    sys.warnoptions.append("ignore:resource_tracker:UserWarning")
    state, token = ConsoleState(None if display is None else Path(display)), secrets.token_urlsafe(_TOKEN_BYTES)

    def said(base: str) -> list[str]:
        page = f"{base}/#token={token}"
        if open_browser:
            webbrowser.open(page)
        return [f"console: {page}"]

    with address.listen() as listening, _held(rig, state, seed) as held, _figures_apart() as apart:
        close = (lambda: None) if held is None else held.close
        run_server(
            build_console(state, token, apart, held),
            address,
            listening,
            said,
            lambda config: ConsoleServer(config, close, state.uploads.forget),
        )


@contextmanager
def _held(spec: str | None, state: ConsoleState, seed: int) -> Iterator[RigProcess | None]:
    """Yield the rig of that name, held by a separate process, or None for none; it is at rest at the end."""

    if spec is None:
        yield None
        return
    with closing(RigProcess(spec, state.display(FILE), seed)) as host:
        yield host


@contextmanager
def _figures_apart() -> Iterator[ProcessPoolExecutor]:
    """Yield a process in which figures are computed, so that a drag's frames have the interpreter to themselves."""

    apart = ProcessPoolExecutor(1, get_context("spawn"), initializer=begin_helper, initargs=(_NICER,))
    try:
        apart.submit(int)  # it imports while the reader opens the page
        yield apart
    finally:
        # Python that ends while a pool closes fails now and then, with a traceback; a long figure is not waited for
        end = Thread(target=apart.shutdown, kwargs={"cancel_futures": True}, daemon=True)
        end.start()
        end.join(_CLOSING_S)

"""1,500 connections that want nothing, at a server with 1,024 descriptors: the open session does not feel them.

`python -m witnesses.connections.idle_crowd --seconds 60` serves a study in a process of its own, lets a subject answer,
and lets a crowd in: a third connect and say nothing, a third send the head of a request a byte a second, a third open a
websocket and are silent. They come from one address, then from a hundred, and those that the server ends come again
after a rest. The claim: of the subject's answers 99 % are acknowledged within 100 ms, the log grows by no more than
100 kB a minute, the server lives and holds fewer descriptors than it may.

The crowd and the subject are clients of other libraries (asyncio's streams, websockets' client) in processes of their
own; times are the subject's. Other work on the machine makes them longer: a bare echo of this process, sent over
loopback through another process in turn with the answers, says by how much. A new page's requests are counted as
well: with every place taken they are often refused, which is told and is no part of the claim.

Seen to fail: `--unlimited` serves without the limits of `tactuator.web.server`. The session is kept waiting, or ends,
once the descriptors are used up.
"""

from __future__ import annotations

import argparse
import socket
import ssl
import sys
import tempfile
import time
from dataclasses import dataclass
from multiprocessing import Process
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from witnesses.connections.crowd import Crowd
from witnesses.connections.serving import UNLIMITED, WHOLE, Answering, Serving, served

DESCRIPTORS = 1024
LONGEST_S, LOG_MAX = 0.1, 100_000
_COMING_S = 30.0
"""Time in which the whole crowd has to come; the answers of this time count as well."""
_TLS = Path(__file__).resolve().parents[2] / "tests" / "web" / "access" / "tls"


@dataclass
class Found:
    """What was seen in one phase. answer_s, echo_s: of each answer and each bare echo. log: bytes a minute."""

    name: str
    answer_s: list[float]
    echo_s: list[float]
    log: float = 0.0
    descriptors: int = 0
    held: int = 0
    tried: int = 0
    pages: int = 0
    asked: int = 0
    ended: str = ""
    crowd: int = 0

    def kept(self) -> bool:
        """Whether the claim holds, and the crowd was there: each of it was taken or refused."""
        return (
            self.tried >= self.crowd
            and not self.ended
            and self.p99_s(self.answer_s) <= LONGEST_S
            and self.log <= LOG_MAX
        )

    @staticmethod
    def p99_s(times: list[float]) -> float:
        return float(np.percentile(times, 99.0)) if times else float("inf")


class Echo:
    """A process that sends back what it gets: what the machine itself takes for a message there and back."""

    def __init__(self) -> None:
        self._mine, theirs = socket.socketpair()
        self._process = Process(target=_send_back, args=(theirs,), daemon=True)
        self._process.start()

    def round_trip(self) -> float:
        began = time.perf_counter()
        self._mine.sendall(b"a")
        self._mine.recv(1)
        return time.perf_counter() - began


def _send_back(end: socket.socket) -> None:
    while content := end.recv(1):
        end.sendall(content)


def observed(
    name: str, serving: Serving, answering: Answering, echo: Echo, seconds: float, crowd: Crowd | None
) -> Found:
    """Let the subject answer for so many seconds, with the crowd there or without it."""
    found = Found(name, [], [])
    if crowd is None:
        _observe(found, serving, answering, echo, seconds)
        return found
    found.crowd = crowd.count
    with crowd.held() as tally:
        came = time.monotonic() + _COMING_S
        while tally.read()["tried"] < crowd.count and time.monotonic() < came:
            found.answer_s.append(answering.answer())
        _observe(found, serving, answering, echo, seconds)
        found.held, found.tried = tally.read()["open"], tally.read()["tried"]
    return found


def _observe(found: Found, serving: Serving, answering: Answering, echo: Echo, seconds: float) -> None:
    began, before, looked = time.monotonic(), serving.log.stat().st_size, 0.0
    try:
        while (passed := time.monotonic() - began) < seconds:
            found.answer_s.append(answering.answer())
            found.echo_s.append(echo.round_trip())
            if passed - looked > 1.0:
                looked = passed
                found.descriptors = max(found.descriptors, serving.descriptors())
                found.asked += 1
                found.pages += _page_is_answered(serving.port)
    except (ConnectionClosed, TimeoutError, OSError) as error:
        found.ended = f"{type(error).__name__}: {error}"
    if serving.process.poll() is not None:
        found.ended = f"the server ended with {serving.process.returncode}"
    found.log = (serving.log.stat().st_size - before) * 60.0 / (time.monotonic() - began)


def _page_is_answered(port: int) -> bool:
    """Whether a connection from another address is taken and not ended at once."""
    try:
        with socket.create_connection(("127.0.0.1", port), 0.5, ("127.0.9.9", 0)) as one:
            one.settimeout(0.1)
            return bool(one.recv(1))
    except TimeoutError:
        return True
    except OSError:
        return False


def phases(arguments: argparse.Namespace, folder: Path) -> list[Found]:
    """Quiet, a crowd of one address, a crowd of a hundred, and quiet again."""
    tls = (_TLS / "certificate.pem", _TLS / "key.pem") if arguments.tls else None
    program = UNLIMITED if arguments.unlimited else WHOLE
    echo, found = Echo(), []
    with served(folder, program, DESCRIPTORS, tls) as serving:
        context = ssl.create_default_context() if tls else None
        if context:
            context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        scheme = "wss" if tls else "ws"
        with connect(f"{scheme}://{serving.address}/ws/subject/{serving.link}", ssl=context) as connection:
            answering = Answering(connection)
            for addresses in (0, 1, 100, 0):
                crowd = None
                if addresses:
                    crowd = Crowd(serving.port, arguments.count, addresses, 4, arguments.again_s, arguments.tls)
                name = f"crowd of {addresses} address(es)" if addresses else "quiet"
                found.append(observed(name, serving, answering, echo, arguments.seconds, crowd))
                if found[-1].ended:
                    break
        print(serving.log.read_text()[-2000:] if arguments.show_log else "", file=sys.stderr)
    return found


def table(found: list[Found]) -> Table:
    made = Table()
    names = "phase,answers,p50 ms,p99 ms,longest ms,echo p99 ms,log B/min,descriptors,held,tried,new pages,kept"
    for name in names.split(","):
        made.add_column(name)
    for one in found:
        times = [1e3 * value for value in one.answer_s] or [float("inf")]
        made.add_row(
            one.name, str(len(one.answer_s)), f"{np.median(times):.1f}", f"{1e3 * one.p99_s(one.answer_s):.1f}",
            f"{max(times):.0f}", f"{1e3 * one.p99_s(one.echo_s):.1f}", f"{one.log:.0f}", str(one.descriptors),
            str(one.held), str(one.tried), f"{one.pages}/{one.asked}", one.ended or ("yes" if one.kept() else "no"),
        )  # fmt: skip
    return made


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="length of each phase")
    parser.add_argument("--count", type=int, default=1500, help="connections of the crowd")
    parser.add_argument("--again-s", type=float, default=5.0, help="rest before a connection is opened again")
    parser.add_argument("--tls", action="store_true", help="serve with a certificate")
    parser.add_argument("--unlimited", action="store_true", help="serve without limits, to see the witness fail")
    parser.add_argument("--show-log", action="store_true", help="print the end of the server's log")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        found = phases(arguments, Path(name))
    Console(width=180).print(table(found))
    return 0 if found and all(one.kept() for one in found) else 1


if __name__ == "__main__":
    sys.exit(main())

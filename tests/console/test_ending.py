"""The console's server ends though something is still computed for a page, and closes the rig before it waits."""

import asyncio
import os
import signal
import socket
import sys
import time

import pytest
import uvicorn
from fastapi import FastAPI

from tactuator.console import app as console
from tactuator.web.server import listener
from tests.web.study import FORKS


def served(said):
    """A process of its own: a server that is asked for what takes minutes; what it complains of is heard as well."""
    os.dup2(said.fileno(), 1)
    os.dup2(said.fileno(), 2)
    sys.stderr = open(2, "w", buffering=1, closefd=False)  # noqa: SIM115
    console.PATIENCE_S = 0.3
    app, sock = FastAPI(), listener("127.0.0.1", 0)

    def say(text):
        os.write(1, f"{text}\n".encode())

    @app.get("/")
    async def long():
        say("computing")
        await asyncio.to_thread(time.sleep, 300)

    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(143))  # as the command line does
    signal.signal(signal.SIGINT, signal.default_int_handler)
    config = uvicorn.Config(app, log_level="warning")
    server = console.ConsoleServer(config, lambda: say("at rest"), lambda: say("forgotten"))
    say(sock.getsockname()[1])
    server.run(sockets=[sock])


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_server__told_to_end_while_it_computes__closes_the_rig_and_ends_without_a_word(number, status):
    hears, said = FORKS.Pipe(duplex=False)
    process = FORKS.Process(target=served, args=(said,), daemon=True)
    process.start()
    said.close()
    try:
        with open(hears.fileno(), closefd=False) as lines:
            with socket.create_connection(("127.0.0.1", int(lines.readline()))) as asking:
                asking.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
                assert lines.readline() == "computing\n"
                os.kill(process.pid, number)
                process.join(60.0)
            assert lines.read().splitlines() == ["at rest", "forgotten"]
    finally:
        process.kill()
        hears.close()
    assert process.exitcode == status

"""The console's server ends though something is still computed for a page, and closes the rig before it waits."""

import signal
import subprocess
import sys

import pytest

PROGRAM = """
import asyncio, signal, sys, time, uvicorn
from fastapi import FastAPI
from tactuator.console.app import ConsoleServer
from tactuator.web.server import listener

app, sock = FastAPI(), listener("127.0.0.1", 0)
say = lambda text: print(text, flush=True)

@app.get("/")
async def long():
    say("computing")
    await asyncio.to_thread(time.sleep, 300)

signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(143))  # as the command line does
server = ConsoleServer(uvicorn.Config(app, log_level="warning"), lambda: say("at rest"), lambda: say("forgotten"))
say(sock.getsockname()[1])
server.run(sockets=[sock])
"""


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_server__told_to_end_while_it_computes__closes_the_rig_and_ends_without_a_word(number, status):
    import socket

    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            with socket.create_connection(("127.0.0.1", int(process.stdout.readline()))) as asking:
                asking.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
                assert process.stdout.readline() == "computing\n"
                process.send_signal(number)
                said, complaints = process.communicate(timeout=60)
        finally:
            process.kill()
    assert said.splitlines() == ["at rest", "forgotten"]
    assert complaints == ""
    assert process.returncode == status

"""Files that are no good, dropped on every view that takes one: told in one line, and what was there before stays."""

import errno
import logging
import socket
import time
from collections.abc import Callable

import numpy as np
import pytest

from tactuator.console.app import build_console
from tactuator.console.connection import REQUESTS as KINDS
from tactuator.console.requests import checked
from tactuator.console.state import ConsoleState
from tactuator.errors import BadInput
from tests.console.pages import TOKEN, dropped
from tests.web.access.mutating import defects
from tests.web.server import served

NOISE = np.random.default_rng(1).bytes(5000)
FILES = {
    "empty.csv": b"",
    **{f"random.{ending}": NOISE for ending in ("csv", "h5", "mat", "wav", "toml")},
    "brackets.toml": b"[" * 50_000,
    "no ending": NOISE,
    "odd näme ☃.csv": b"time_s,command_v,position_v\n0,1,2\n1,x,2\n2,nan,inf\n",
}
"""What each reader refuses stands in tests/io; here is whether a view tells it."""
REQUESTS = {
    "identify": {"do": "identify.model", "record": None},
    "display": {"do": "display.read", "file": None},
    "prefilter": {"do": "prefilter.curve", "file": None},
    "speech": {"do": "speech.render", "display": "example:display.toml", "file": None},
    "experiment": {"do": "experiment.look", "protocol": None},
}


@pytest.fixture(scope="module")
def state():
    return ConsoleState()


@pytest.mark.parametrize("view", REQUESTS)
def test_file_that_is_no_good__dropped_on_a_view__is_refused_in_one_line(state, tmp_path, view):
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content)
        key = dropped(state, tmp_path / name)
        request = checked(KINDS, {"id": 1, **{k: v or key for k, v in REQUESTS[view].items()}})
        answer, said = {}, ""
        try:
            with state.uploads.named_plainly():
                answer = request.answer(state)
        except BadInput as refusal:
            said = str(refusal)
        assert ("\n" in said, str(state.uploads.folder()) in said) == (False, False), name
        if not said:  # a display that can be read is shown as it is, and its fault told
            assert view == "display", name
            judge = checked(KINDS, {"id": 2, "do": "display.judge", "text": answer["text"][:60_000]})
            assert judge.answer(state)["fault"], name


def test_name_of_a_dropped_file__stays_within_the_folder_of_the_drawer():
    async def blocks():
        yield b"1,2\n"

    for name in ("", ".hidden", "a" * 200 + ".csv", "new\nline.csv", "../../up.csv", "c:\\x\\y.csv"):
        state = ConsoleState()
        with pytest.raises((BadInput, StopIteration)) as ended:  # a coroutine returns by the latter
            state.uploads.take(name, blocks()).send(None)
        if isinstance(ended.value, StopIteration):
            path = state.uploads.path(ended.value.value)
            assert (path.is_relative_to(state.uploads.folder()), path.name in ("up.csv", "y.csv")) == (True, True)
        else:
            assert "allowed" in str(ended.value)


def comes_to_be(is_so: Callable[[], bool]) -> bool:
    end = time.monotonic() + 30.0
    while not is_so() and time.monotonic() < end:
        time.sleep(0.02)
    return is_so()


def test_drop__whose_sender_goes_before_its_end__leaves_nothing_and_logs_nothing(state, monkeypatch, caplog):
    head = (
        f"POST /drop HTTP/1.1\r\nHost: localhost\r\nX-Token: {TOKEN}\r\nX-Name: a.csv\r\nContent-Length: 9\r\n\r\na,b"
    )
    with served(build_console(state, TOKEN)) as client:
        monkeypatch.setattr(logging.getLogger("uvicorn"), "propagate", True)
        before = len(list(state.uploads.folder().iterdir()))
        with socket.create_connection(("127.0.0.1", client.port)) as stranger:
            stranger.sendall(head.replace(TOKEN, "another").encode())
            assert stranger.recv(99).startswith(b"HTTP/1.1 403 ")
        with socket.create_connection(("127.0.0.1", client.port)) as one:
            one.sendall(head.encode())
            assert comes_to_be(lambda: len(list(state.uploads.folder().iterdir())) == before + 1)
        assert comes_to_be(lambda: len(list(state.uploads.folder().iterdir())) == before)
        assert client.get("/").status == 200
    assert defects(caplog) == []


def test_drop__on_a_full_disk__is_refused_in_one_line(monkeypatch):
    async def blocks():
        raise OSError(errno.ENOSPC, "No space left on device")
        yield b""

    state = ConsoleState()
    with pytest.raises(BadInput, match=r"a.csv cannot be kept: No space left on device; allowed"):
        state.uploads.take("a.csv", blocks()).send(None)
    assert not list(state.uploads.folder().iterdir())

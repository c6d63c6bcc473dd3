"""Files that are no good, dropped on every view that takes one: told in one line, and what was there before stays."""

import errno
import logging
import socket
import time

import h5py
import numpy as np
import pytest
import scipy.io
import soundfile

from tactuator.console.app import build_console
from tactuator.console.connection import REQUESTS as KINDS
from tactuator.console.requests import checked
from tactuator.console.state import ConsoleState
from tactuator.errors import BadInput
from tactuator.io.shipped import EXAMPLES
from tests.console.pages import TOKEN, console_page, dropped, go
from tests.web.access.mutating import defects
from tests.web.server import served

U, Y = np.random.default_rng(0).standard_normal((2, 4000)) * 0.1


def empty(path):
    path.write_bytes(b"")


def random_bytes(path):
    path.write_bytes(np.random.default_rng(1).bytes(5000))


def cut_sound(path):
    soundfile.write(path, np.stack([U, Y], axis=1), 8000, format="WAV")
    path.write_bytes(path.read_bytes()[:3000])


def claiming_hdf5(path):
    with h5py.File(path, "w") as file:
        for name in ("command", "position"):
            file.create_dataset(name, shape=(600_000_000, 2), dtype="f4", chunks=True, compression="gzip")


def cut_matlab(path):
    with path.open("wb") as file:
        scipy.io.savemat(file, {"u": U, "y": Y, "fs": 1000.0}, do_compression=True)
    path.write_bytes(path.read_bytes()[:2000])


def endless_line(path):
    path.write_text("1," * 600_000)


def brackets(path):
    path.write_text("[" * 50_000)


def one_column(path):
    path.write_text("time_s\n" + "\n".join(str(one) for one in range(50)))


def not_numbers(path):
    path.write_text("time_s,command_v,position_v\n0,1,2\n1,x,2\n2,nan,inf\n")


FILES = {
    "empty.csv": empty, "random.csv": random_bytes, "random.h5": random_bytes, "random.mat": random_bytes,
    "random.wav": random_bytes, "cut.wav": cut_sound, "claim.h5": claiming_hdf5, "cut.mat": cut_matlab,
    "endless.csv": endless_line, "brackets.toml": brackets, "random.toml": random_bytes, "one.csv": one_column,
    "letters.csv": not_numbers, "no ending": random_bytes, "odd näme ☃.csv": not_numbers,
}  # fmt: skip
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


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("view", REQUESTS)
def test_file_that_is_no_good__dropped_on_a_view__is_refused_in_one_line(state, tmp_path, view, name):
    FILES[name](tmp_path / name)
    key = dropped(state, tmp_path / name)
    request = checked(KINDS, {"id": 1, **{k: v or key for k, v in REQUESTS[view].items()}})
    if view == "display" and name not in ("random.toml",):
        judged_as_text(state, request)
        return
    with pytest.raises(BadInput) as told, state.uploads.named_plainly():
        request.answer(state)
    assert "\n" not in str(told.value)
    assert str(state.uploads.folder()) not in str(told.value)


def judged_as_text(state, request):
    """A text that can be read is shown as it is, and its fault told; bytes that are none are refused."""
    try:
        text = request.answer(state)["text"]
    except BadInput:
        return
    if len(text) <= 60_000:
        judged = checked(KINDS, {"id": 2, "do": "display.judge", "text": text}).answer(state)
        assert judged["fault"]


@pytest.mark.parametrize("name", ["", ".hidden", "a" * 200 + ".csv", "new\nline.csv", "../../up.csv", "c:\\x\\y.csv"])
def test_name_of_a_dropped_file__stays_within_the_folder_of_the_drawer(name):
    state = ConsoleState()

    async def blocks():
        yield b"1,2\n"

    take = state.uploads.take(name, blocks())
    with pytest.raises((BadInput, StopIteration)) as ended:  # a coroutine returns by the latter
        take.send(None)
    if isinstance(ended.value, StopIteration):
        path = state.uploads.path(ended.value.value)
        assert path.is_relative_to(state.uploads.folder())
        assert path.name in ("up.csv", "y.csv")
    else:
        assert "allowed" in str(ended.value)


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
            time.sleep(0.05)
        time.sleep(0.05)
        assert client.get("/").status == 200
        assert len(list(state.uploads.folder().iterdir())) == before
    assert defects(caplog) == []


def test_drop__on_a_full_disk__is_refused_in_one_line(monkeypatch):
    async def blocks():
        raise OSError(errno.ENOSPC, "No space left on device")
        yield b""

    state = ConsoleState()
    with pytest.raises(BadInput, match=r"a.csv cannot be kept: No space left on device; allowed"):
        state.uploads.take("a.csv", blocks()).send(None)
    assert not list(state.uploads.folder().iterdir())


@pytest.mark.slow
def test_bad_file__dropped_after_a_good_one__is_told_where_it_was_dropped_and_the_model_stays(browser, tmp_path):
    bad = tmp_path / "bad.csv"
    not_numbers(bad)
    text = (EXAMPLES / "display.toml").read_text("utf-8")
    with console_page(browser) as page:
        go(page, "display", display="example:display.toml")
        page.wait_for_selector("#use")
        random_bytes(tmp_path / "bad.toml")
        page.locator("input[type=file]").set_input_files(tmp_path / "bad.toml")
        page.wait_for_selector(".drop .told:has-text('not text')")
        assert page.locator("#text").input_value() == text
        go(page, "prefilter", display="example:display.toml")
        page.wait_for_selector("#error:has-text('Greatest error')")
        page.locator("input[type=file]").set_input_files(bad)
        page.wait_for_selector(".drop .told:has-text('bad.csv')")
        assert page.locator(".handles .handle").count() > 10

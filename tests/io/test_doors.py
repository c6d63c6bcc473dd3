"""Doors for an attacker who hands over a file, a name or a place: files that take their numbers from others, control
characters in what is printed, links in the place of a lock."""

import asyncio
import io
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from unittest.mock import AsyncMock

import h5py
import numpy as np
import pytest
import uvicorn
from fastapi import FastAPI

from tactuator.api import recognition
from tactuator.api.progress import say
from tactuator.cli import output
from tactuator.cli.main import main
from tactuator.console.state import ConsoleState
from tactuator.errors import BadInput, visible
from tactuator.experiment.store.store import sessions_of
from tactuator.io import hdf5
from tactuator.io.csv_tables import read_curve
from tactuator.io.display import read_display
from tactuator.io.hdf5 import opened_hdf5
from tactuator.io.text import require_inside
from tactuator.web.pages import HEADERS
from tactuator.web.server import PageServer
from tactuator.web.sockets import same_origin


def external(file, secret):
    file.create_dataset("a", (16,), "u1", external=[(str(secret), 0, 16)])


def external_in_a_group(file, secret):
    file.create_group("b").create_dataset("a", (16,), "u1", external=[(str(secret), 0, 16)])


def virtual(file, secret):
    layout = h5py.VirtualLayout((4,), "f8")
    layout[:] = h5py.VirtualSource(str(secret), "x", (4,))
    file.create_virtual_dataset("a", layout)


def linked(file, secret):
    file["a"] = h5py.ExternalLink(str(secret), "/x")


def linked_in_a_group(file, secret):
    file.create_group("b")["a"] = h5py.ExternalLink(str(secret), "/x")


@pytest.mark.parametrize("leads", [external, external_in_a_group, virtual, linked, linked_in_a_group])
def test_hdf5__that_takes_numbers_from_another_file__is_refused(tmp_path, leads):
    with h5py.File(tmp_path / "secret", "w") as file:
        file["x"] = np.arange(4.0)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        leads(file, tmp_path / "secret")
    with pytest.raises(BadInput, match="numbers from other files"), opened_hdf5(tmp_path / "a.h5"):
        pass


def test_hdf5__20_000_tiny_datasets__is_refused_with_a_tenth_of_them_named_and_none_opened(tmp_path, monkeypatch):
    for count in (1000, 20_000):
        with h5py.File(tmp_path / f"{count}.h5", "w", libver="latest") as file:
            for k in range(count):  # by the library itself, in a tenth of the time
                h5py.h5d.create(file.id, b"d%d" % k, h5py.h5t.IEEE_F64LE, h5py.h5s.create(h5py.h5s.SCALAR))
    with opened_hdf5(tmp_path / "1000.h5") as file:
        assert len(file) == 1000
    log, visit = tmp_path / "log", h5py.File.visit

    def logged(kind):
        with log.open("a") as written:  # a child process looks the file through
            written.write(kind)

    monkeypatch.setattr(h5py.File, "visit", lambda file, keep: visit(file, lambda name: (logged("n"), keep(name))[1]))
    monkeypatch.setattr(hdf5, "_is_elsewhere", lambda *item: logged("o"))
    monkeypatch.setattr(hdf5, "_look", lambda item: logged("o"))
    with pytest.raises(BadInput, match="more than 2000 datasets"), opened_hdf5(tmp_path / "20000.h5"):
        pass
    assert log.read_text() == 2001 * "n"


@pytest.mark.parametrize("mark", ["\x1b[2J", "\x07", "\x9b1m", "\u202e", "\u2066", "\u200f", "\u2028", "\x7f"])
def test_printed__control_character_or_mark_of_direction__is_escaped(tmp_path, capsys, mark):
    assert main(["check", str(tmp_path / f"a{mark}b.json")]) == 2
    said = capsys.readouterr().err
    assert mark[0] not in said
    assert f"\\u{ord(mark[0]):04x}" in said
    assert visible(str(BadInput(mark, mark))) == str(BadInput(mark, mark))
    assert visible("Ω ä 中\tµ") == "Ω ä 中\tµ"


@pytest.mark.parametrize("shows", ["said", "told", "asked", "served", "bar", "line", "dumb"])
def test_terminal__text_of_a_protocol_or_a_name__can_neither_command_it_nor_be_taken_for_markup(monkeypatch, shows):
    """A protocol that another laboratory wrote has texts for subjects, and names; so has a display file."""
    screen, text = io.StringIO(), "\x1b]0;x\x07 [/b] \u202e"
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))
    monkeypatch.setattr("sys.stderr.isatty", lambda: shows != "line", raising=False)
    monkeypatch.setenv("TERM", "dumb" if shows == "dumb" else "xterm")
    if shows == "served":
        server = PageServer(uvicorn.Config(FastAPI()))
        server.said = [text]
        monkeypatch.setattr(uvicorn.Server, "startup", AsyncMock())
        with ThreadPoolExecutor(1) as other:  # a browser's test may have left its loop in this thread
            other.submit(asyncio.run, server.startup()).result()
    elif shows in ("bar", "line", "dumb"):
        monkeypatch.setattr(output, "EVERY_S", 0.01)
        with output.Bars()(text, 1.0) as step:
            step(0.5, text=text)
            while not screen.getvalue():
                time.sleep(0.01)
    else:
        {"said": say, "told": recognition._tell, "asked": recognition._typed}[shows](text)
    assert "\\u001b]0;x\\u0007 [/b] \\u202e" in screen.getvalue()
    assert "\x07" not in screen.getvalue()


def test_lock__that_is_a_link__is_not_followed(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (tmp_path / "s.sqlite.lock").symlink_to(victim)
    with pytest.raises(BadInput, match=r"s\.sqlite\.lock"), sessions_of(tmp_path / "s.sqlite"):
        pass
    assert victim.read_text() == "precious"


@pytest.mark.parametrize("path", ["/etc/passwd", "../../etc/passwd", "a/../../x", "/nothing/there", "link/passwd"])
def test_typed_display__path_out_of_its_folder__is_refused_unread(tmp_path, path):
    (tmp_path / "link").symlink_to("/etc")
    text = f'[threshold]\ncurve = "{path}"\n'
    with pytest.raises(BadInput, match="a path within its file's folder") as refusal:
        ConsoleState().take_text(text, tmp_path)
    assert "root" not in str(refusal.value)


SECRET = "hunter2"
PRIVATE = {
    "notes.txt": f"{SECRET}, of the laboratory\n",
    "notes.csv": f"{SECRET},{SECRET}\n1,2\n3,4\n",
    "curve.csv": f"frequency_hz,level_db_re_1um\n1,{SECRET}\n2,3\n",
    "pairs.csv": f"time_s,{SECRET}\n0,1\n1,2\n",
    "broken.toml": f"password = {SECRET}\n",
    "twice.toml": f"[{SECRET}]\n[{SECRET}]\n",
    "key.toml": f"{SECRET} = {{ a = 1, a = 2 }}\n",
    "format.json": f'{{"format": "{SECRET}", "channels": {{"{SECRET}": 1}}}}',
    "model.json": f'{{"num": [1], "den": [1, 2], "{SECRET}": 3, "quantity": "{SECRET}"}}',
    "environment.json": f'{{"format": "tactuator-environment/1", "channels": {{"{SECRET}": "{SECRET}"}}}}',
}
NAMING = {
    "curve": '[threshold]\ncurve = "{}"\n',
    "contours": '[strength]\ncontours = "{}"\n',
    "measured": '[environment]\nmeasured = "{}"\n',
    "plant": "",
    "plants": "",
}


@pytest.mark.parametrize("key", NAMING)
@pytest.mark.parametrize("name", PRIVATE)
def test_typed_display__that_names_a_private_file__repeats_none_of_it(tmp_path, key, name):
    (tmp_path / name).write_text(PRIVATE[name])
    plant = {"plant": f'"{name}"', "plants": f'["{name}"]'}.get(key, "{ num = [950.0], den = [1.0, 60.0, 1600.0] }")
    head = '[display]\nname = "a"\nrate_hz = 4000.0\n' + NAMING[key].format(name)
    text = head + f'[[channel]]\nname = "thumb"\nplant = {plant}\n'
    with pytest.raises(BadInput) as refusal:
        ConsoleState().take_text(text, tmp_path)
    assert SECRET not in str(refusal.value) + str(refusal.value.document())


@pytest.mark.parametrize("key", NAMING)
@pytest.mark.parametrize("name", ["a" * 300, "a" * 300 + ".csv", "a/" * 3000 + "b.json", "locked/x.csv"])
def test_typed_display__name_that_no_file_can_have__is_refused_in_a_sentence(tmp_path, key, name):
    (tmp_path / "locked").write_text("a file, not a folder")
    plant = {"plant": f'"{name}"', "plants": f'["{name}"]'}.get(key, "{ num = [950.0], den = [1.0, 60.0, 1600.0] }")
    head = '[display]\nname = "a"\nrate_hz = 4000.0\n' + NAMING[key].format(name)
    with pytest.raises(BadInput) as refusal:
        ConsoleState().take_text(head + f'[[channel]]\nname = "thumb"\nplant = {plant}\n', tmp_path)
    assert len(str(refusal.value)) < 4500


def test_typed_display__path_with_a_nul__is_refused(tmp_path):
    text = '[display]\nname = "a"\nrate_hz = 4000.0\n[[channel]]\nname = "thumb"\nplant = "a\\u0000"\n'
    with pytest.raises(BadInput, match="no file has such a name"):
        ConsoleState().take_text(text, tmp_path)


def test_uploaded_protocol__file_out_of_its_folder__is_refused_unread(tmp_path):
    for path in ("/etc/passwd", "../private.toml"):
        with pytest.raises(BadInput, match="within its file's folder"):
            require_inside({"files": [path]}, tmp_path)


@pytest.mark.parametrize("name", ["broken.toml", "twice.toml", "key.toml", "notes.csv"])
def test_refused_file__of_toml_or_csv__is_not_quoted(tmp_path, name):
    (tmp_path / name).write_text(PRIVATE[name])
    read = read_curve if name.endswith(".csv") else read_display
    with pytest.raises(BadInput) as refusal:
        read(tmp_path / name)
    assert SECRET not in str(refusal.value)


@pytest.mark.parametrize("origin", ["http://[", "http://[::1", "http://a]b", "//[x"])
def test_origin__malformed__is_refused_quietly(origin):
    socket = SimpleNamespace(headers={"origin": origin, "host": "127.0.0.1:8000"})
    assert not same_origin(socket)


def test_pages__policy__connects_to_their_own_host_alone():
    policy = dict(rule.strip().split(" ", 1) for rule in HEADERS["Content-Security-Policy"].split(";"))
    assert policy["connect-src"] == policy["form-action"] == "'self'"
    assert policy["base-uri"] == "'none'"

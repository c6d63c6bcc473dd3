"""Folders: whoever renders them, interrupted or not, the references are the same; no file is dropped in silence."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future
from pathlib import Path

import numpy as np
import psutil
import pytest
import soundfile

from tactuator.errors import BadInput, DeviceFault
from tactuator.io.controller import write_controller
from tactuator.io.display import parse_display
from tactuator.io.reference import content_sha256
from tactuator.speech import folder as module
from tactuator.speech.folder import find_items, render_folder, workers_of
from tactuator.speech.render import RenderJob
from tactuator.synthesis.design import design_controller
from tests.three_fingers import three_finger_display

BAD = ["notes.wav", "silent.wav"]
GOOD = [f"speaker{number % 2}/word{number}.{'flac' if number == 3 else 'wav'}" for number in range(6)]


@pytest.fixture(scope="module")
def job():
    three = three_finger_display()
    return RenderJob(design_controller(parse_display(three | {"channel": three["channel"][:1]})))


def speak(path: Path, hertz: float, seconds: float = 1.0):
    path.parent.mkdir(parents=True, exist_ok=True)
    noise = 0.01 * np.random.default_rng(round(hertz)).standard_normal(round(16000 * seconds))
    soundfile.write(path, noise + 0.3 * np.sin(2 * np.pi * hertz * np.arange(noise.size) / 16000), 16000)


@pytest.fixture
def speech(tmp_path):
    for number, name in enumerate(GOOD):
        speak(tmp_path / "speech" / name, 110.0 + 10.0 * number)
    (tmp_path / "speech" / "notes.wav").write_text("not a sound")
    (tmp_path / "speech" / "silent.wav").write_bytes(b"")
    return tmp_path / "speech"


class Here(Executor):
    """This process, one file after the other; interrupted after some."""

    def __init__(self, stop_after: int = 1000):
        self.left = stop_after

    def submit(self, fn, /, *args, **kwargs):
        if not self.left:
            raise KeyboardInterrupt
        self.left -= 1
        future: Future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def kept(result):
    return [file["source"] for file in result.files if file["kept"]]


def content(out):
    whole = (path for path in out.rglob("[!.]*") if path.is_file())  # what a killed worker leaves has a hidden name
    return {path.relative_to(out): path.read_bytes() for path in whole}


def test_render_folder__one_process_or_two__same_bytes_and_failures_listed(job, speech, tmp_path):
    here = render_folder(speech, tmp_path / "here", job, Here())
    with workers_of(2) as workers:
        pool = render_folder(speech, tmp_path / "pool", job, workers)
    assert content(tmp_path / "here") == content(tmp_path / "pool")
    assert here == pool
    assert [file["source"] for file in here.files] == sorted(GOOD)
    assert [failure["source"] for failure in here.failures] == BAD
    assert all("\n" not in failure["error"] and "; " in failure["error"] for failure in here.failures)


def test_render_folder__interrupted__goes_on_and_keeps_what_is_whole(job, speech, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        render_folder(speech, out, job, Here(4))
    assert kept(render_folder(speech, out, job, Here())) == ["speaker0/word0.wav", "speaker0/word2.wav"]
    render_folder(speech, tmp_path / "whole", job, Here())
    assert content(out) == content(tmp_path / "whole")


def test_render_folder__reference_or_speech_or_settings_changed__are_rendered_anew(job, speech, tmp_path):
    out = tmp_path / "out"
    first = render_folder(speech, out, job, Here())
    before = content(out)
    (out / "speaker0/word0.wav").unlink()
    path = out / "speaker0/word2.wav"
    path.write_bytes(path.read_bytes()[:-400] + bytes(400))  # at its length
    path = out / "speaker0/word4.json"
    path.write_text(path.read_text().replace('"level_db_sl": 35.0', '"level_db_sl": 34.0'))
    again = render_folder(speech, out, job, Here())
    assert kept(again) == ["speaker1/word1.wav", "speaker1/word3.flac", "speaker1/word5.wav"]
    assert content(out) == before
    assert [file | {"kept": False} for file in again.files] == list(first.files)
    speak(speech / "speaker0/word0.wav", 90.0)
    assert "speaker0/word0.wav" not in kept(render_folder(speech, out, job, Here()))
    assert kept(render_folder(speech, out, RenderJob(job.controller, job.coding, 30.0), Here())) == []


def test_find_items__links_and_names_alike__are_taken_or_left_out_by_name(tmp_path, job):
    words = tmp_path / "words"
    for name in ("b/word.wav", "b/word.flac", "a.OGG", ".h.wav", "out/old.wav", "notes.txt", "call.m4a", "x.haptic"):
        (words / name).parent.mkdir(parents=True, exist_ok=True)
        (words / name).write_bytes(b"")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "far.sph").write_bytes(b"")
    (words / "linked").symlink_to(tmp_path / "elsewhere")
    (words / "b" / "back").symlink_to(words)
    items, left_out = find_items(words, words / "out")
    assert {item.source: item.out for item in items} == {
        "a.OGG": "a.wav", "b/word.flac": "b/word.flac.wav", "b/word.wav": "b/word.wav.wav",
        "linked/far.sph": "linked/far.wav", "x.haptic": "x.wav",
    }  # fmt: skip
    assert left_out == (".h.wav", "call.m4a", "notes.txt")
    (tmp_path / "empty").mkdir()
    for place, out, said in ((tmp_path / "empty", "out", "holds nothing to render"), (words, "words", "holds"),
                             (words / "b", "words", "holds")):  # fmt: skip
        with pytest.raises(BadInput, match=said):
            find_items(place, tmp_path / out)
    (tmp_path / "out").write_text("in the way")
    with pytest.raises(BadInput, match="cannot be made"):
        render_folder(words, tmp_path / "out", job, Here())


def test_render_folder__worker_killed__is_told_and_gone_on_with(job, speech, tmp_path):
    def kill(done, total):
        servers = [child for child in psutil.Process().children() if "forkserver" in " ".join(child.cmdline())]
        for worker in [worker for server in servers for worker in server.children()]:
            worker.kill()

    with pytest.raises(DeviceFault, match=r"ended at work on .*long.*; expected the"), workers_of(2) as workers:
        for number in range(6):  # longer than the workers live
            speak(speech / f"long{number}.wav", 200.0, 60.0)
        render_folder(speech, tmp_path / "out", job, workers, lambda done, total: done and kill(done, total))
    result = render_folder(speech, tmp_path / "out", job, Here())
    assert (len(result.files), [failure["source"] for failure in result.failures]) == (12, BAD)


def test_render__interrupted_at_the_terminal__leaves_whole_references(job, tmp_path):
    write_controller(tmp_path / "c.json", job.controller)
    for number in range(8):
        speak(tmp_path / "long" / f"{number}.wav", 150.0, 60.0)
    command = [sys.executable, "-m", "tactuator", "render", "long", "--controller", "c.json", "--out", "out"]
    with subprocess.Popen([*command, "--workers", "2"], cwd=tmp_path, stderr=subprocess.PIPE, text=True) as program:
        while not list(tmp_path.glob("out/[!.]*.wav")):
            time.sleep(0.02)
        helpers = psutil.Process(program.pid).children(recursive=True)
        program.send_signal(signal.SIGINT)
        _, said = program.communicate(timeout=60)
    assert (program.returncode, said) == (130, "tactuator: interrupted; written: out\n")
    assert psutil.wait_procs(helpers, timeout=10.0)[1] == []
    left = [path.name for path in (tmp_path / "out").iterdir()]
    assert 2 <= len(left) < 16
    assert not [name for name in left if name.startswith(".")]
    for path in (tmp_path / "out").glob("*.wav"):
        assert content_sha256(path) == json.loads(path.with_suffix(".json").read_text())["sha256"]


def free_address():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp://127.0.0.1:{free.getsockname()[1]}"


def test_workers__without_a_scheduler__are_refused_in_one_line(monkeypatch):
    monkeypatch.setattr(module, "_ANSWER_S", 1.0)
    for address in (free_address(), "nonsense", "http://["):
        with pytest.raises(BadInput, match="no Dask scheduler") as refusal, workers_of(None, address):
            pass
        assert "\n" not in str(refusal.value)


@pytest.mark.slow
def test_dask__worker_killed_in_mid_run__complete_and_equal_to_serial(job, speech, tmp_path):
    distributed = pytest.importorskip("distributed")
    render_folder(speech, tmp_path / "serial", job, Here())
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    )
    killed = threading.Event()

    def kill_once(done, total):
        if done >= 3 and not killed.is_set():
            killed.set()
            os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)

    try:
        with workers_of(None, cluster.scheduler_address) as workers:
            result = render_folder(speech, tmp_path / "out", job, workers, kill_once)
    finally:
        cluster.close()
    assert killed.is_set()
    assert len(result.files) == 6
    assert content(tmp_path / "out") == content(tmp_path / "serial")


@pytest.mark.slow
def test_dask__scheduler_killed__is_told_in_one_line_and_gone_on_with_later(job, speech, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_ANSWER_S", 30.0)
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    address = free_address()
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard", "--host", address]
    scheduler = subprocess.Popen(command, **quiet)
    worker = subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-dashboard"], **quiet)
    for number in range(12):
        speak(speech / f"long{number}.wav", 200.0, 60.0)
    try:
        with workers_of(None, address) as workers, pytest.raises(DeviceFault, match="the command again"):
            render_folder(speech, tmp_path / "out", job, workers, lambda done, total: done == 3 and scheduler.kill())
    finally:
        for process in (scheduler, worker):
            process.kill()
            process.wait()
    assert len(kept(render_folder(speech, tmp_path / "out", job, Here()))) >= 1


def test_find_items__folders_linked_to_each_other__are_walked_once_each_way(tmp_path, job):
    for name in ("a", "b"):
        (tmp_path / "words" / name).mkdir(parents=True)
        (tmp_path / "words" / name / "x.haptic").write_text("{}")
    (tmp_path / "words" / "a" / "to").symlink_to(tmp_path / "words" / "b")
    (tmp_path / "words" / "b" / "to").symlink_to(tmp_path / "words" / "a")
    items, _ = find_items(tmp_path / "words", tmp_path / "out")
    assert [item.source for item in items] == ["a/to/x.haptic", "a/x.haptic", "b/to/x.haptic", "b/x.haptic"]

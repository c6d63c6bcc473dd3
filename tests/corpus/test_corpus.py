"""Corpora: whatever computes them, interrupted or not, the result is the same."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading

import numpy as np
import psutil
import pytest
import soundfile

from tactuator.corpus.corpus import MANIFEST, run_corpus
from tactuator.corpus.corpus import NAME as JOURNAL
from tactuator.corpus.task import CorpusOutcome, CorpusTask, find_items
from tactuator.corpus.workers import ATTEMPTS_MAX, DaskCluster, Here, LocalProcesses
from tactuator.errors import BadInput, DeviceFault
from tactuator.io.display import parse_display
from tactuator.io.reference import content_sha256
from tactuator.speech.band_codings import DirectCoding
from tactuator.speech.render import RenderJob
from tactuator.synthesis.design import design_controller
from tests.three_fingers import three_finger_display


@pytest.fixture(scope="module")
def job():
    three = three_finger_display()
    index = parse_display(three | {"channel": three["channel"][:1]})
    return RenderJob(design_controller(index), DirectCoding(), simulate=True, seed=4)


@pytest.fixture
def corpus(tmp_path):
    rng, time_s = np.random.default_rng(0), np.arange(16000) / 16000
    for number in range(6):
        folder = tmp_path / "speech" / f"speaker{number % 2}"
        folder.mkdir(parents=True, exist_ok=True)
        wave = 0.3 * np.sin(2 * np.pi * (110 + 10 * number) * time_s) + 0.01 * rng.standard_normal(len(time_s))
        soundfile.write(folder / f"word{number}.{'flac' if number == 3 else 'wav'}", wave, 16000)
    (tmp_path / "speech" / "notes.wav").write_text("not a sound")
    (tmp_path / "speech" / "silent.wav").write_bytes(b"")
    (tmp_path / "speech" / "readme.txt").write_text("not looked at")
    return tmp_path / "speech"


def same_manifest(folder, other):
    return (folder / MANIFEST).read_bytes() == (other / MANIFEST).read_bytes()


def test_run_corpus__one_process_or_two__same_manifest_and_samples(job, corpus, tmp_path):
    here = run_corpus(corpus, tmp_path / "here", job, Here())
    pool = run_corpus(corpus, tmp_path / "pool", job, LocalProcesses(2))
    assert (here.done, here.kept, len(here.failures)) == (6, 0, 2)
    assert same_manifest(tmp_path / "here", tmp_path / "pool")
    for entry in json.loads((tmp_path / "pool" / MANIFEST).read_text())["files"]:
        assert content_sha256(tmp_path / "pool" / entry["out"]) == entry["sha256"]
        assert entry["felt"]["index"]["rms_db"] < 1.0
    assert pool.manifest["duration_s"] == pytest.approx(6.0)
    assert [failure["source"] for failure in pool.failures] == ["notes.wav", "silent.wav"]
    assert all("\n" not in failure["error"] and "allowed" in failure["error"] for failure in pool.failures)


class Counts:
    def __init__(self, stop_after=None):
        self.items, self.stop_after = [], stop_after

    def outcomes(self, tasks):
        self.items = [task.item for task in tasks]
        for number, outcome in enumerate(Here().outcomes(tasks)):
            if number == self.stop_after:
                raise KeyboardInterrupt
            yield outcome


def test_run_corpus__interrupted__goes_on_where_it_stopped(job, corpus, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        run_corpus(corpus, out, job, Counts(4))
    assert not (out / MANIFEST).exists()
    finished = sorted(out.rglob("*.wav"))
    before = {path: path.stat().st_mtime_ns for path in finished}
    with (out / JOURNAL).open("a") as journal:
        journal.write('{"item": "speaker1/word5.wav", "figures": {"level": NaN, "peak": 1e999}}\n')  # changed by a disk
        journal.write('{"item": "speaker1/word5.wav", "figu')  # a line that a crash cut off
    counting = Counts()
    result = run_corpus(corpus, out, job, counting)
    assert result.kept == 2  # the two bad files came first and were tried again
    assert len(counting.items) == 6
    done_again = [path for path, written in before.items() if path.stat().st_mtime_ns != written]
    assert len(before) == 3
    assert len(done_again) == 1  # it was written, but the interruption came before its line in the journal
    run_corpus(corpus, tmp_path / "whole", job, Here())
    assert same_manifest(out, tmp_path / "whole")
    again = Counts()
    assert run_corpus(corpus, out, job, again).kept == 6
    assert again.items == ["notes.wav", "silent.wav"]


def test_run_corpus__outputs_changed_at_their_length_changed_speech_lost_reference_or_other_level__done_anew(
    job, corpus, tmp_path
):
    out, counting = tmp_path / "out", Counts()
    run_corpus(corpus, out, job, Here())
    before = {path: path.read_bytes() for path in out.rglob("*") if path.suffix in (".wav", ".json")}
    rng = np.random.default_rng(3)
    for number in range(6):
        path = out / f"speaker{number % 2}" / f"word{number}.{'json' if number == 5 else 'wav'}"
        content = bytearray(path.read_bytes())
        at = 0 if path.suffix == ".json" else int(rng.integers(len(content)))
        content[at : at + 4096] = bytes(len(content[at : at + 4096]))
        path.write_bytes(content)
    run_corpus(corpus, out, job, counting)
    assert len(counting.items) == 8
    assert {path: path.read_bytes() for path in before} == before  # to the byte, whenever they were written
    soundfile.write(corpus / "speaker0" / "word0.wav", 0.2 * np.sin(np.arange(16000) / 15.0), 16000)
    (out / "speaker1" / "word1.wav").unlink()
    run_corpus(corpus, out, job, counting)
    assert sorted(counting.items) == ["notes.wav", "silent.wav", "speaker0/word0.wav", "speaker1/word1.wav"]
    run_corpus(corpus, out, RenderJob(job.controller, job.coding, 30.0, True, 4), counting)
    assert len(counting.items) == 8


def test_run_corpus__half_written_files_of_a_killed_worker__swept(job, corpus, tmp_path):
    out = tmp_path / "out"
    (out / "speaker0").mkdir(parents=True)
    script = "import os, sys\nfrom tactuator.io.atomic import atomic_path\nwith atomic_path(sys.argv[1]): os._exit(1)"
    subprocess.run([sys.executable, "-c", script, str(out / "speaker0/word0.wav")], check=False)
    assert len(list(out.rglob(".*"))) == 1
    (out / "speaker0" / ".word0-x1y2_abc.tactuator.json").write_bytes(b"half")
    mine = [".word0-take2.wav", ".notes-2024.json", ".other-x1y2_abc.tactuator.wav"]
    for name in mine:
        (out / "speaker0" / name).write_bytes(b"the user's")
    run_corpus(corpus, out, job, Here())
    assert sorted(path.name for path in out.rglob(".*")) == sorted(mine)


def test_run_corpus__another_run_in_the_same_folder__refused(job, corpus, tmp_path):
    def second(done, total):
        with pytest.raises(BadInput, match="another run"):
            run_corpus(corpus, tmp_path / "out", job, Here())

    with pytest.raises(KeyboardInterrupt):
        run_corpus(corpus, tmp_path / "out", job, Counts(0), progress=second)
    assert run_corpus(corpus, tmp_path / "out", job, Here()).done == 6


def test_local_processes__a_worker_killed__its_task_is_done_by_another(job, corpus, tmp_path):
    run_corpus(corpus, tmp_path / "here", job, Here())
    killed = []

    def kill_once(done, total):
        servers = [child for child in psutil.Process().children() if "forkserver" in " ".join(child.cmdline())]
        busy = [worker for server in servers for worker in server.children()]
        if done >= 2 and not killed and busy:
            os.kill(busy[-1].pid, signal.SIGKILL)
            killed.append(busy[-1].pid)

    result = run_corpus(corpus, tmp_path / "out", job, LocalProcesses(2), progress=kill_once)
    assert killed
    assert result.done == 6
    assert same_manifest(tmp_path / "out", tmp_path / "here")


def _dies(task: CorpusTask) -> CorpusOutcome:
    os._exit(9)


def test_workers__that_die_or_have_no_scheduler__are_told_in_one_line(monkeypatch):
    monkeypatch.setattr("tactuator.corpus.workers.do_task", _dies)
    task = CorpusTask("a.wav", "", "", "", "", 35.0, False, 0)
    (outcome,) = LocalProcesses(1).outcomes([task])
    assert outcome.error == f"a.wav: its worker died {ATTEMPTS_MAX} times; not rendered"
    with pytest.raises(BadInput, match="one or more"):
        LocalProcesses(0)
    for address in (free_address(), "nonsense", "http://[", ""):
        with pytest.raises(BadInput, match="no Dask scheduler") as refusal:
            DaskCluster(address, timeout_s=1.0)
        assert "\n" not in str(refusal.value)


@pytest.mark.slow
def test_dask_cluster__a_worker_killed_in_mid_run__complete_and_equal_to_serial(job, corpus, tmp_path):
    distributed = pytest.importorskip("distributed")
    run_corpus(corpus, tmp_path / "serial", job, Here())
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    )
    try:
        killed = threading.Event()

        def kill_once(done, total):
            if done >= 3 and not killed.is_set():
                killed.set()
                os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)

        with DaskCluster(cluster.scheduler_address) as workers:
            result = run_corpus(corpus, tmp_path / "out", job, workers, progress=kill_once)
    finally:
        cluster.close()
    assert killed.is_set()
    assert result.done == 6
    assert same_manifest(tmp_path / "out", tmp_path / "serial")


@pytest.mark.slow
def test_dask_cluster__its_scheduler_killed__told_in_one_line_and_gone_on_with_later(job, corpus, tmp_path):
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    address = free_address()
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard", "--host", address]
    scheduler = subprocess.Popen(command, **quiet)
    worker = subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-dashboard"], **quiet)
    try:

        def kill_once(done, total):
            if done == 3:
                scheduler.kill()

        with DaskCluster(address, timeout_s=30.0) as workers, pytest.raises(DeviceFault) as fault:
            run_corpus(corpus, tmp_path / "out", job, workers, progress=kill_once)
    finally:
        for process in (scheduler, worker):
            process.kill()
            process.wait()
    assert str(fault.value).startswith(f"the Dask scheduler at '{address}' has ended; allowed: the command again")
    assert "\n" not in str(fault.value)
    assert run_corpus(corpus, tmp_path / "out", job, Here()).kept >= 1


def free_address():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp://127.0.0.1:{free.getsockname()[1]}"


def test_find_items__same_stem_or_nothing_to_read__keep_their_endings_or_are_refused(tmp_path, job, corpus):
    for name in ("b/word.wav", "b/word.flac", "a.OGG", ".hidden.wav", "out/old.wav", "text.txt"):
        path = tmp_path / "words" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
    got = {item.source: item.out for item in find_items(tmp_path / "words", tmp_path / "words" / "out")}
    assert got == {"a.OGG": "a.wav", "b/word.flac": "b/word.flac.wav", "b/word.wav": "b/word.wav.wav"}
    (tmp_path / "empty").mkdir()
    for place in (tmp_path / "none", tmp_path / "empty"):
        with pytest.raises(BadInput, match="allowed"):
            find_items(place, tmp_path / "out")
    (tmp_path / "out").write_text("in the way")
    with pytest.raises(BadInput, match="cannot be made"):
        run_corpus(corpus, tmp_path / "out", job, Here())

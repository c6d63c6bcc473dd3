"""Calls that may not come back."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import pytest

from tactuator.errors import DeviceFault
from tactuator.rig.sound import cards as audio_thread
from tactuator.rig.sound.cards import AudioThread


def test_answer__several_jobs__their_results_from_one_thread():
    calls = AudioThread()
    names = {calls.answer(lambda: threading.current_thread().ident, "looking") for _ in range(3)}
    assert len(names) == 1
    assert names != {threading.current_thread().ident}


def test_answer__job_that_fails__raises_what_it_raised_and_goes_on():
    calls = AudioThread()
    with pytest.raises(ZeroDivisionError):
        calls.answer(lambda: 1 // 0, "dividing")
    assert calls.answer(lambda: 7, "counting") == 7


def test_answer__job_that_hangs__one_fault_and_each_later_call_fails(monkeypatch):
    monkeypatch.setattr(audio_thread, "ANSWER_S", 0.05)
    calls, go, undone = AudioThread(), threading.Event(), threading.Event()

    def late() -> str:
        go.wait(10.0)
        return "a stream"

    with pytest.raises(DeviceFault, match=r"opening: the sound system has not answered for 0\.05 s; allowed: "):
        calls.answer(late, "opening", lambda made: undone.set() if made == "a stream" else None)
    with pytest.raises(DeviceFault, match="opening"):
        calls.answer(lambda: 7, "counting")
    assert not undone.is_set()
    go.set()
    assert undone.wait(10.0)  # what came too late is let go of


GIVES_UP = """
import ctypes, os, sys, threading
from tactuator.errors import DeviceFault
from tactuator.rig.sound import cards as audio_thread
audio_thread.ANSWER_S = 1e4  # the fault does not wait for it
calls = audio_thread.AudioThread()
print(calls.answer(lambda: 7, "counting"))
if sys.argv[1] == "elsewhere":
    inside = threading.Event()
    threading.Thread(target=lambda: inside.wait() and os.abort()).start()
    calls.answer(lambda: (inside.set(), threading.Event().wait(20.0)), "looking")
for job in (ctypes.CDLL(None).abort, lambda: 8):  # as a library aborts: without the interpreter's lock
    try:
        calls.answer(job, "opening")
    except DeviceFault as fault:
        print(fault)
"""


def program_that_gives_up(where: str) -> subprocess.CompletedProcess[str]:
    asked = [sys.executable, "-c", GIVES_UP, where]
    return subprocess.run(asked, capture_output=True, text=True, timeout=30, check=False)


@pytest.mark.skipif(os.name == "nt", reason="a library is named there")
def test_answer__library_that_calls_abort__one_fault_and_the_program_goes_on():
    done = program_that_gives_up("in the thread")
    assert done.returncode == 0, done.stderr
    counted, *faults = done.stdout.splitlines()
    assert counted == "7"
    words = "opening: the sound system has failed, as it does where its server ends; allowed: "
    assert [fault.startswith(words) for fault in faults] == [True, True]


@pytest.mark.skipif(os.name == "nt", reason="there are no signals' numbers there")
def test_answer__abort_in_another_thread__ends_the_program():
    assert program_that_gives_up("elsewhere").returncode == -signal.SIGABRT

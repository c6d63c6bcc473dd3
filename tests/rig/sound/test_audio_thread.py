"""Calls that may not come back."""

from __future__ import annotations

import threading

import pytest

from tactuator.errors import DeviceFault
from tactuator.rig.sound import audio_thread
from tactuator.rig.sound.audio_thread import AudioThread


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

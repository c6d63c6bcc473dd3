"""Programs of boards: how they are built, beside what the verbs of `firmware` say of them."""

import subprocess
import threading
import time
from pathlib import Path

import pytest

from tactuator.errors import BadInput
from tactuator.rig import boards as program
from tactuator.rig.boards import build_firmware


def test_build_firmware__asked_twice_at_once__compiles_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled, built = [], []

    def compiler(command: list[str], **given: object) -> subprocess.CompletedProcess[str]:
        compiled.append(command)
        time.sleep(0.2)
        Path(command[command.index("-o") + 1]).write_bytes(b"program")
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(program, "_cache", lambda: tmp_path)
    monkeypatch.setattr(program, "_require", lambda tool: None)
    monkeypatch.setattr(program.subprocess, "run", compiler)
    both = [threading.Thread(target=lambda: built.append(build_firmware("mps2-an386"))) for _ in range(2)]
    for one in both:
        one.start()
    for one in both:
        one.join()
    assert len(compiled) == 1
    assert built[0] == built[1]
    assert list(tmp_path.iterdir()) == [built[0]]


def test_build_firmware__after_one_that_failed__compiles_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program, "_cache", lambda: tmp_path)
    monkeypatch.setattr(program, "_require", lambda tool: None)
    failed = subprocess.CompletedProcess([], 1, "", "core/x.c:1: error: no such thing")
    monkeypatch.setattr(program.subprocess, "run", lambda command, **given: failed)
    for _ in range(2):
        with pytest.raises(BadInput, match=r"does not compile: core/x\.c:1: error: no such thing; allowed"):
            build_firmware("mps2-an386")
    assert list(tmp_path.iterdir()) == []

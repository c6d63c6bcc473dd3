"""Boards are found by the board.toml of their folders."""

import subprocess
import threading
import time
from pathlib import Path

import pytest

from tactuator.errors import BadInput
from tactuator.rig import boards as program
from tactuator.rig.boards import BOARDS, ROOT, build_firmware, read_boards

OWN = """
[own-board]
describes = "Cortex-M4F"
processor = "cortex-m4"
floating_point = "fpv4-sp-d16"
script = "own.ld"
rows = 512
machine = "none"
timer_hz = 1e6
"""


def test_boards__folders_of_firmware__all_are_found_with_their_linker_scripts():
    assert list(BOARDS) == ["mps2-an386", "mps2-an500", "stm32f405"]
    assert all((ROOT / "firmware" / board.folder / board.script).is_file() for board in BOARDS.values())
    assert [name for name, board in BOARDS.items() if board.is_real] == ["stm32f405"]


@pytest.mark.parametrize("text", [OWN + "speed = 3\n", OWN.replace("rows = 512\n", ""), "[own-board\n", "rows = 3\n"])
def test_boards__a_folder_more__its_board_is_there_or_its_file_is_named(tmp_path, text):
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "board.toml").write_text(OWN)
    assert read_boards(tmp_path)["own-board"].folder == "own"
    (tmp_path / "own" / "board.toml").write_text(text)
    with pytest.raises(BadInput, match=r"own/board\.toml: .*; allowed: a table for each board"):
        read_boards(tmp_path)


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
    assert set(tmp_path.iterdir()) == {built[0], built[0].with_suffix(".txt")}

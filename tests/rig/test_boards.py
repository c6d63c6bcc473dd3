"""Boards are found by the board.toml of their folders."""

import pytest

from tactuator.errors import BadInput
from tactuator.rig.boards import BOARDS, ROOT, find_board, read_boards

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


def test_boards__a_folder_more__its_board_is_there_too(tmp_path):
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "board.toml").write_text(OWN)
    found = read_boards(tmp_path)["own-board"]
    assert (found.folder, found.rows, found.serial, found.is_real) == ("own", 512, 0, False)


@pytest.mark.parametrize("text", [OWN + "speed = 3\n", OWN.replace("rows = 512\n", ""), "[own-board\n", "rows = 3\n"])
def test_boards__unknown_or_missing_key_or_no_toml__file_is_named(tmp_path, text):
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "board.toml").write_text(text)
    with pytest.raises(BadInput, match=r"own/board\.toml: .*; allowed: a table for each board"):
        read_boards(tmp_path)


def test_find_board__name_not_known__all_are_listed():
    with pytest.raises(BadInput, match="board 'avr' is not known; allowed: mps2-an386, mps2-an500, stm32f405"):
        find_board("avr")

"""Programs of boards: found by the board.toml of their folders, compiled without a warning, written in every form."""

import re
import struct
from dataclasses import replace
from pathlib import Path

import pytest

from firmware import build as builder
from firmware.__main__ import main
from firmware.build import FIRMWARE, build, find_board, memory_used, read_boards, write_program
from tactuator.errors import BadInput
from tactuator.rig.transport import BAUD, SerialPort
from tests.firmware import chip_model
from tests.firmware.emulator import MACHINES

PAGE = builder.ROOT / "docs" / "porting.md"
OWN = """
describes = "Cortex-M4F"
processor = "cortex-m4"
floating_point = "fpv4-sp-d16"
rows = 512
clock_hz = 1e6
"""


def test_boards__folders_of_firmware__all_are_found_with_their_linker_scripts() -> None:
    assert [path.parent.name for path in FIRMWARE.glob("*/*.ld")] == list(read_boards()) == ["stm32f405"]
    with pytest.raises(BadInput, match="board 'nucleo' is not known; expected stm32f405"):
        find_board("nucleo")


@pytest.mark.parametrize("text", [OWN + "speed = 3\n", OWN.replace("rows = 512\n", ""), "own = [\n", "rows = 3\n"])
def test_boards__a_folder_more__its_board_is_there_or_its_file_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "board.toml").write_text(OWN)
    assert read_boards(tmp_path)["own"].rows == 512
    (tmp_path / "own" / "board.toml").write_text(text)
    with pytest.raises(BadInput, match=r"own/board\.toml: .*; expected the keys of Board"):
        read_boards(tmp_path)


@pytest.mark.parametrize("board", [find_board("stm32f405"), *(machine.board for machine in MACHINES.values())])
def test_program__of_every_board__compiles_without_a_warning(board: builder.Board) -> None:
    assert build(board).with_suffix(".txt").read_text() == ""


def words_of_a_hex_file(text: str) -> bytes:
    """What an Intel HEX file holds, as one piece; its addresses follow on from each other."""
    content, begun, base = bytearray(), None, 0
    for line in text.split():
        record = bytes.fromhex(line[1:])
        assert sum(record) % 256 == 0
        count, at, kind = record[0], int.from_bytes(record[1:3], "big"), record[3]
        if kind == 4:
            base = int.from_bytes(record[4:6], "big") << 16
        if kind == 0:
            begun = base + at if begun is None else begun
            assert base + at == begun + len(content)
            content += record[4 : 4 + count]
    assert begun == 0x08000000
    return bytes(content)


def test_program__for_a_board_one_can_buy__is_the_same_in_every_form(tmp_path: Path, capsys) -> None:
    """Stack and reset vector where the chip looks for them; .hex and .bin hold the same bytes."""
    for form in ("bin", "hex", "elf"):
        assert main(["program", "--out", str(tmp_path / f"f.{form}")]) == 0
    assert "STM32F405, Cortex-M4F, " in capsys.readouterr().out
    flash, ram = memory_used(tmp_path / "f.elf")
    assert flash <= 1 << 20
    assert 64 << 10 < ram <= 96 << 10
    said = re.search(r"uses (\d+) kB of 1 MiB of flash and (\d+) kB of 128 KiB of RAM", PAGE.read_text())
    assert said
    assert [int(kb) for kb in said.groups()] == [round(size / 1000) for size in (flash, ram)]
    assert f"ring buffer ({find_board('stm32f405').rows} rows on the STM32F405)" in PAGE.read_text()
    content = (tmp_path / "f.bin").read_bytes()
    stack, reset = struct.unpack_from("<2I", content)
    assert 0x20000000 < stack <= 0x20020000
    assert reset & 1 == 1
    assert 0x08000000 < reset < 0x08000000 + len(content)
    assert words_of_a_hex_file((tmp_path / "f.hex").read_text()) == content
    assert main(["program", "--out", str(tmp_path / "f.dfu")]) == 2
    assert "f.dfu: a program's name ends in '.dfu'; expected .elf, .bin, .hex" in capsys.readouterr().err


def test_program__that_does_not_fit_or_lacks_its_tools__is_refused(tmp_path: Path, monkeypatch) -> None:
    program = build(find_board("stm32f405"))
    monkeypatch.setattr(builder, "CACHE", tmp_path)
    with pytest.raises(BadInput, match="region `data' overflowed by"):
        build(replace(find_board("stm32f405"), rows=4096))
    monkeypatch.setenv("PATH", "")
    for missing, act in (("gcc", lambda: build(find_board("stm32f405"))), ("size", lambda: memory_used(program)),
                         ("objcopy", lambda: write_program(program, tmp_path / "f.bin"))):  # fmt: skip
        with pytest.raises(BadInput, match=f"arm-none-eabi-{missing} is missing: install it with `make"):
            act()


@pytest.mark.parametrize("baud", [BAUD, pytest.param(2_500_000, marks=pytest.mark.slow)])
def test_program__for_a_baud_rate__both_ends_have_it_within_what_a_byte_bears(
    tmp_path, capsys, monkeypatch, baud
) -> None:
    assert main(["program", "--baud", str(baud), "--out", str(tmp_path / "f.bin")]) == 0
    port = capsys.readouterr().out.split("reach it as board:")[1].strip()
    opened: dict[str, int] = {}
    monkeypatch.setattr("serial.serial_for_url", lambda name, rate, **more: opened.update({name: rate}))
    SerialPort(port)
    assert opened == {"PORT": baud}
    on = chip_model.Drivers(chip_model.build(tmp_path, baud), chip_model.Chip())
    on.call("tact_bus_begin")
    on.call("tact_usart_begin")
    assert 42e6 / on.chip.registers[chip_model.USART3 + 8] == pytest.approx(opened["PORT"], rel=0.016)


def test_program__for_a_baud_rate_that_the_chip_has_not__is_refused(tmp_path: Path, capsys) -> None:
    assert main(["program", "--baud", "3000000", "--out", str(tmp_path / "f.bin")]) == 2
    assert "a baud rate within 1.5 % of 42 MHz by a whole number from 16 on" in capsys.readouterr().err

"""`tactuator firmware`, as a user runs it."""

import json
import struct
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest

from tactuator.cli import main
from tactuator.io.controller import write_controller
from tactuator.model.description import Display
from tactuator.rig import boards as program
from tactuator.rig import emulator
from tactuator.rig.boards import BOARDS, build_firmware
from tactuator.rig.period_check import PeriodCheck
from tactuator.rig.period_cost import PeriodCost
from tests.cli.controller.controller_files import made  # noqa: F401
from tests.cli.refusals import refused
from tests.runtime.paper_display import channel, controller, display


def test_verify__few_ticks__bit_exact_in_both_formats(made: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["firmware", "verify", "--board", "mps2-an386", "--ticks", "1000", "--controller", made]
    assert main([*arguments, "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    found = json.loads(out)
    expected = {"bit_exact": True, "first_difference": "", "ticks": 1000, "channels": 1, "formats": ["float32", "q31"]}
    assert {key: found[key] for key in expected} == expected
    assert found["board"] == "mps2-an386"
    assert found["running_ticks"] > 1000
    assert found["played"] > 1000


def test_verify__that_differs__status_1(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    differing = PeriodCheck("mps2-an500", False, "float32: seed 1, tick 5", 9, 3, ("float32", "q31"), 9, 1, (), 0)
    monkeypatch.setattr("tactuator.rig.period_check.check_period", lambda *arguments: differing)
    monkeypatch.setattr("tactuator.rig.open.open_rig", lambda *arguments: nullcontext())
    assert main(["firmware", "verify", "--ticks", "5"]) == 1
    assert "DIFFERENT (float32: seed 1, tick 5)" in capsys.readouterr().out.replace("\n", "")


def test_bench__at_80_columns__names_of_boards_are_whole(made, monkeypatch, capsys) -> None:
    cases = dict.fromkeys(("usual", "silent", "soft start", "limited", "on-board tones", "faults"), 1234)
    share = {"168 MHz": 0.02}
    counted = [PeriodCost(name, "float32", 1, 1234, 1234, cases, share, share) for name in BOARDS]
    monkeypatch.setattr(
        "tactuator.rig.period_cost.count_instructions", lambda board, *given: counted[list(BOARDS).index(board)]
    )
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["firmware", "bench", "--controller", made]) == 0
    out = capsys.readouterr().out
    assert "…" not in out
    for board in BOARDS:
        assert board in out


@pytest.mark.slow
def test_bench__one_finger__every_board_in_both_formats(made: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["firmware", "bench", "--controller", made, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["board"], row["format"]) for row in rows] == [
        (board, number_format) for board in BOARDS for number_format in ("float32", "q31")
    ]
    for row in rows:
        assert {"board", "format", "channels", "instructions_per_tick"} <= set(row)
        assert row["channels"] == 1
        assert 50 < row["instructions_per_tick"] < 3000
        assert row["instructions_per_tick"] == row["cases"]["usual"]
        assert row["worst"] == max(row["cases"].values())
        assert set(row["cases"]) == {"usual", "silent", "soft start", "limited", "on-board tones", "faults"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["verify", "--rig", "simulated"], "rig 'simulated' is no connected board; allowed: board:PORT"),
        (["bench", "--rig", "emulated:stm32f405"], "is no connected board; allowed: board:PORT or board:URL"),
        (["verify", "--board", "nucleo"], "board 'nucleo' is not known; allowed: mps2-an386, mps2-an500, stm32f405"),
        (["verify", "--ticks", "0"], "ticks is 0; allowed: 1 or more"),
        (["verify", "--ticks", "many"], "'many'"),
        (["program", "--board", "nucleo", "--out", "FOLDER/f.elf"], "board 'nucleo' is not known"),
        (["program", "--out", "FOLDER/none/f.elf"], "none is not a folder"),
        (["program", "--out", "FOLDER/f.dfu"], "f.dfu: a program's name ends in '.dfu'; allowed: .elf, .bin, .hex"),
        (["program", "--board", "stm32f405", "--crystal-mhz", "32"], "32"),
        (["weld"], "weld"),
    ],
)
def test_firmware__misused__is_refused(
    arguments: list[str], words: str, made: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = ["--controller", made] if "verify" in arguments else []
    refused(["firmware", *arguments, *told], words, capsys, tmp_path)


@pytest.mark.parametrize(
    ("of", "words"),
    [
        (display(channel(), delay_samples=0), "delay_samples is 0; allowed: 1 to 8 on a board"),
        (display(*(replace(channel(), name=name) for name in "abcde")), "the board has 3 channels; the display has 5"),
    ],
    ids=["no delay", "five channels"],
)
@pytest.mark.parametrize("verb", ["verify", "bench"])
def test_firmware__display_that_no_board_has__is_refused(
    verb: str, of: Display, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "controller.json"
    write_controller(path, controller(of))
    refused(["firmware", verb, "--controller", str(path)], words, capsys, tmp_path)


EVERY_VERB = (["verify"], ["bench"], ["program", "--out", "FOLDER/f.elf"])


@pytest.mark.parametrize("verb", EVERY_VERB, ids=lambda verb: verb[0])
def test_firmware__no_compiler__says_what_to_install(
    verb: list[str], made: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cache = tmp_path / "cache"
    cache.mkdir()
    monkeypatch.setattr(program, "_cache", lambda: cache)
    monkeypatch.setenv("PATH", "")
    told = ["--controller", made] if "program" not in verb else []
    words = f"{program.COMPILER} is missing; allowed: install it with `make install-boards`"
    refused(["firmware", *verb, *told], words, capsys, tmp_path)


@pytest.mark.parametrize("verb", ["verify", "bench"])
def test_firmware__no_emulator__says_what_to_install(
    verb: str, made: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for board in BOARDS:
        build_firmware(board)
    monkeypatch.setenv("PATH", "")
    words = f"{emulator.EMULATOR} is missing; allowed: install it with `make install-boards`"
    refused(["firmware", verb, "--controller", made], words, capsys, tmp_path)


def test_firmware__sources_that_do_not_compile__are_refused_and_leave_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cache = tmp_path / "cache"
    cache.mkdir()
    monkeypatch.setattr(program, "_cache", lambda: cache)
    monkeypatch.setattr(program, "FLAGS", (*program.FLAGS, "-include", "there-is-no-such-header.h"))
    refused(["firmware", "program", "--out", str(tmp_path / "f.elf")], "does not compile", capsys, tmp_path)


def test_program__good__is_an_elf_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "f.elf"
    assert main(["firmware", "program", "--board", "mps2-an386", "--out", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["board"], found["program"]) == ("mps2-an386", str(out))
    assert out.read_bytes().startswith(b"\x7fELF")


def words_of_a_hex_file(text: str) -> bytes:
    """What an Intel HEX file holds, as one piece; its addresses follow on from each other."""
    found, begun, base = bytearray(), None, 0
    for line in text.split():
        record = bytes.fromhex(line[1:])
        assert sum(record) % 256 == 0
        count, at, kind = record[0], int.from_bytes(record[1:3], "big"), record[3]
        if kind == 4:
            base = int.from_bytes(record[4:6], "big") << 16
        if kind == 0:
            begun = base + at if begun is None else begun
            assert base + at == begun + len(found)
            found += record[4 : 4 + count]
    assert begun == 0x08000000
    return bytes(found)


def test_program__for_a_board_one_can_buy__is_the_same_in_every_form(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Stack and reset vector where the chip looks for them; .hex and .bin hold the same bytes."""
    for form in ("bin", "hex", "elf"):
        told = ["firmware", "program", "--board", "stm32f405", "--out", str(tmp_path / f"f.{form}"), "--json"]
        assert main(told) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["flash_bytes"] <= 1 << 20
        assert 64 << 10 < found["ram_bytes"] <= 128 << 10
    content = (tmp_path / "f.bin").read_bytes()
    stack, reset = struct.unpack_from("<2I", content)
    assert 0x20000000 < stack <= 0x20020000
    assert reset & 1 == 1
    assert 0x08000000 < reset < 0x08000000 + len(content)
    assert words_of_a_hex_file((tmp_path / "f.hex").read_text()) == content
    assert (tmp_path / "f.elf").read_bytes().startswith(b"\x7fELF")


def test_program__that_does_not_fit_the_board__is_refused_by_the_linker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cache = tmp_path / "cache"
    cache.mkdir()
    monkeypatch.setattr(program, "_cache", lambda: cache)
    quick = tuple("-O0" if flag == "-O2" else flag for flag in program.FLAGS)
    monkeypatch.setattr(program, "FLAGS", quick)  # the rows take as much room however the code is compiled
    monkeypatch.setitem(BOARDS, "stm32f405", replace(BOARDS["stm32f405"], rows=4096))
    told = ["firmware", "program", "--board", "stm32f405", "--out", str(tmp_path / "f.bin")]
    refused(told, "region `data' overflowed by", capsys, tmp_path)

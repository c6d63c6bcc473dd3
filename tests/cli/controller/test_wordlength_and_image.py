"""`tactuator wordlength`, `build`, `image` and `firmware`, as a user runs them."""

import re
import struct
from contextlib import nullcontext
from dataclasses import replace

import pytest

from tactuator.io.controller import read_controller, write_controller
from tactuator.model.controller import Limits
from tactuator.rig import boards as program
from tactuator.rig import emulator
from tactuator.rig.boards import BOARDS, build_firmware
from tactuator.rig.period_check import PeriodCheck
from tactuator.rig.period_cost import PeriodCost
from tests.rig.guard.guarded import designed
from tests.runtime.paper_display import changed, channel, controller, display, louder


def test_wordlength__another_rate_and_a_figure__bits_and_float32_are_told_and_drawn(desk, run) -> None:
    reported = run.json("wordlength", "controller.json", "--rate", "2000", "--figures", "figures")
    assert set(reported) == {"rate_hz", "bits", "float32", "figures"}
    assert (reported["rate_hz"], reported["figures"]) == (2000.0, "figures")
    assert set(reported["bits"]) == {"prefilter", "feedback"}
    for forms in reported["bits"].values():
        assert set(forms) == {"direct", "sections", "delta"}
        for by_rate in forms.values():
            assert list(by_rate) == ["2000.0", "4000.0", "8000.0", "16000.0"]
            assert all(0 <= bits["stable"] <= bits["accurate"] for bits in by_rate.values())
    figures = {"response_error_db", "roundoff_db_sl", "limit_cycle_db_sl"}
    assert set(reported["float32"]) == {"stable", "safe", "refused"} | figures
    assert reported["float32"]["safe"]
    assert sorted(path.name for path in (desk / "figures").iterdir()) == ["resolution.csv", "resolution.svg"]


def test_loop_that_does_not_close__float32_is_not_safe_and_no_image_is_built(desk, run) -> None:
    write_controller("controller.json", louder(read_controller("controller.json"), 60.0))
    ended = run("wordlength", "controller.json")
    assert ended.status == 1
    assert re.search(r"safe\s+no", ended.out)
    (desk / "image.bin").write_bytes(b"old")
    words = "float32 is not safe for this controller (unstable); allowed: what `wordlength` calls safe"
    run.refused("build", "controller.json", "--out", "image.bin", said=words)
    assert (desk / "image.bin").read_bytes() == b"old"


def test_wordlength__what_no_image_holds__is_told_with_status_1(desk, run) -> None:
    of = display(channel())
    wide = tuple(replace(each, converter=replace(each.converter, range_v=40.0)) for each in of.channels)
    write_controller("controller.json", changed(controller(replace(of, channels=wide)), limits=Limits(40.0, 2.0)))
    ended = run("wordlength", "controller.json")
    assert ended.status == 1
    assert "its command limit is out of range" in " ".join(ended.out.split())


def test_build__twice_then_image__same_bytes_and_say_the_same_of_them(desk, run) -> None:
    image = desk / "image.bin"
    words = ("build", "controller.json", "--out", image)
    assert run(*words).status == 0
    before, built = image.read_bytes(), run.json(*words)
    assert image.read_bytes() == before
    assert (built["image"], built["bytes"]) == (str(image), len(before))
    assert (built["rate_hz"], built["channels"]) == (4000.0, 1)
    assert built["controller"] == read_controller("controller.json").content_hash
    assert 0.0 <= built.pop("response_error_db") < 1e-3
    read = run.json("image", image, "--controller", "controller.json")
    assert (read.pop("is_of_controller"), read["delay_samples"]) == (True, 1)
    assert read == built
    assert built["crc32"] in run("image", image).out
    spoilt = changed(read_controller("controller.json"), limits=Limits(9.0, 2.0))
    write_controller("controller.json", spoilt)
    assert run.json("image", image, "--controller", "controller.json", status=1)["is_of_controller"] is False


def test_image__spoilt_or_for_another_display__is_refused(desk, run) -> None:
    """The core's refusals by name: tests/runtime/test_image."""
    image = desk / "image.bin"
    assert run("build", "controller.json", "--out", image).status == 0
    content = image.read_bytes()
    for name, changes, words in (
        ("rate", {"rate_hz": 8000.0}, "it is for another rate than the board runs at"),
        ("delay", {"delay_samples": 2}, "it is for another computing delay"),
        ("fingers", {"channels": display().channels}, "it is for another number of channels"),
    ):
        write_controller(f"{name}.json", controller(replace(display(channel()), **changes)))
        run.refused("image", image, "--controller", f"{name}.json", said=words)
    for spoilt, words in (
        (content[:-1], "it is truncated, or longer than it says"),
        (content + b"\0", "it is truncated, or longer than it says"),
        (content[:90] + bytes([content[90] ^ 4]) + content[91:], "its checksum does not fit"),
        (b"PNG!" + content[4:], "it is no image; allowed: a file that `build` wrote"),
    ):
        image.write_bytes(spoilt)
        run.refused("image", image, said=words)


CASES = ("usual", "silent", "soft start", "limited", "on-board tones", "faults")


def test_verify__few_ticks_or_different__bit_exact_or_status_1(desk, run, monkeypatch) -> None:
    words = ("--board", "mps2-an386", "--ticks", "1000", "--controller", "controller.json")
    checked = run.json("firmware", "verify", *words)
    expected = {"bit_exact": True, "first_difference": "", "ticks": 1000, "channels": 1}
    assert checked == checked | expected | {"board": "mps2-an386"}
    assert min(checked["running_ticks"], checked["played"]) > 500
    differing = PeriodCheck("mps2-an500", False, "seed 1, tick 5", 9, 3, 9, 1, (), 0)
    monkeypatch.setattr("tactuator.rig.period_check.check_period", lambda *arguments: differing)
    monkeypatch.setattr("tactuator.rig.open.open_rig", lambda *arguments: nullcontext())
    ended = run("firmware", "verify", "--ticks", "5", "--controller", "controller.json")
    assert ended.status == 1
    assert "DIFFERENT (seed 1, tick 5)" in ended.out.replace("\n", "")


def test_bench__at_80_columns__names_of_boards_are_whole(desk, monkeypatch, run) -> None:
    cases, share = dict.fromkeys(CASES, 1234), {"168 MHz": 0.02}
    counted = [PeriodCost(name, 1, 1234, 1234, cases, share, share) for name in BOARDS]
    count = lambda board, *given: counted[list(BOARDS).index(board)]  # noqa: E731
    monkeypatch.setattr("tactuator.rig.period_cost.count_instructions", count)
    monkeypatch.setenv("COLUMNS", "80")
    out = run("firmware", "bench", "--controller", "controller.json").out
    assert "…" not in out
    assert all(board in out for board in BOARDS)


@pytest.mark.slow
def test_bench__one_finger__every_board(desk, run) -> None:
    rows = run.json("firmware", "bench", "--controller", "controller.json")
    assert [row["board"] for row in rows] == list(BOARDS)
    for row in rows:
        assert row["channels"] == 1
        assert 50 < row["instructions_per_tick"] == row["cases"]["usual"] < 3000
        assert row["worst"] == max(row["cases"].values())
        assert set(row["cases"]) == set(CASES)


@pytest.mark.parametrize(
    ("of", "words"),
    [
        (display(channel(), delay_samples=0), "delay_samples is 0; allowed: 1 to 8 on a board"),
        (display(*(replace(channel(), name=name) for name in "abcde")), "the board has 3 channels; the display has 5"),
    ],
    ids=["no delay", "five channels"],
)
def test_firmware__display_that_no_board_has__is_refused(of, words: str, desk, run) -> None:
    write_controller(desk / "other.json", controller(of))
    for verb in ("verify", "bench"):
        run.refused("firmware", verb, "--controller", "other.json", said=words)


def test_firmware__no_compiler_or_no_emulator__says_what_to_install(desk, monkeypatch, run) -> None:
    build_firmware("mps2-an386")
    monkeypatch.setenv("PATH", "")
    verify = ("firmware", "verify", "--board", "mps2-an386", "--controller", "controller.json")
    run.refused(*verify, said=f"{emulator.EMULATOR} is missing; allowed: install it with `make install-boards`")
    (desk / "cache").mkdir()
    monkeypatch.setattr(program, "_cache", lambda: desk / "cache")
    words = f"{program.COMPILER} is missing; allowed: install it with `make install-boards`"
    for command in (verify, ("firmware", "bench"), ("firmware", "program", "--out", "f.elf")):
        run.refused(*command, said=words)


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


def test_program__for_a_board_one_can_buy__is_the_same_in_every_form(desk, run) -> None:
    """Stack and reset vector where the chip looks for them; .hex and .bin hold the same bytes."""
    for form in ("bin", "hex", "elf"):
        written = run.json("firmware", "program", "--board", "stm32f405", "--out", f"f.{form}")
        assert (written["board"], written["program"]) == ("stm32f405", f"f.{form}")
        assert written["flash_bytes"] <= 1 << 20
        assert 64 << 10 < written["ram_bytes"] <= 128 << 10
    content = (desk / "f.bin").read_bytes()
    stack, reset = struct.unpack_from("<2I", content)
    assert 0x20000000 < stack <= 0x20020000
    assert reset & 1 == 1
    assert 0x08000000 < reset < 0x08000000 + len(content)
    assert words_of_a_hex_file((desk / "f.hex").read_text()) == content
    assert (desk / "f.elf").read_bytes().startswith(b"\x7fELF")


def test_program__that_does_not_fit_the_board__is_refused_by_the_linker(desk, monkeypatch, run) -> None:
    (desk / "cache").mkdir()
    monkeypatch.setattr(program, "_cache", lambda: desk / "cache")
    quick = tuple("-O0" if flag == "-O2" else flag for flag in program.FLAGS)
    monkeypatch.setattr(program, "FLAGS", quick)  # the rows take as much room however the code is compiled
    monkeypatch.setitem(BOARDS, "stm32f405", replace(BOARDS["stm32f405"], rows=4096))
    words = ("firmware", "program", "--board", "stm32f405", "--out", "f.bin")
    run.refused(*words, said="region `data' overflowed by")


def test_stream__fast_enough_and_far_too_slow__status_0_with_one_object_and_1(desk, run) -> None:
    write_controller(desk / "designed.json", designed())
    words = ("firmware", "stream", "--controller", "designed.json", "--seconds", "0.2", "--instruction-ns")
    said = run.json(*words, "4")
    assert said["holds"]
    assert said["bit_exact"]
    assert (said["board"], said["channels"], said["samples"], said["played"]) == ("mps2-an500", 3, 800, 800)
    assert (said["late"], said["dry"], said["dropped"], said["fault"]) == (0, 0, 0, "none")
    # twelve bytes a sample there and twice that back is the least there can be
    assert said["to_board_bytes_per_s"] * said["board_s"] > 12 * 800
    assert said["from_board_bytes_per_s"] * said["board_s"] > 24 * 800
    ended = run(*words, "256")
    assert ended.status == 1
    assert "late" in ended.out

"""The interrupt's path under libFuzzer and sanitisers, with invariants of what is put out."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tactuator.rig.board.commissioning import safety_table
from tactuator.runtime.image import build_image
from tactuator.runtime.safety_table import safety_bytes
from tests.rig.guard.guarded import adaptive, designed, uncommon

ROOT = Path(__file__).resolve().parents[2]
PARTS = ("arithmetic", "board", "control", "strength", "touch", "wire")
COVERED = ("board/period.c", "board/board.c", "board/stream.c", "board/guard.h")
CLEAR, ARM, START, STOP, OFF, ACKNOWLEDGE, STREAM, RUN, NOISE, SILENT, LATE, IMAGE, SAFETY, TONES, EVENT, RAW = range(
    16
)


def write_tables(folder: Path) -> None:
    """Designed tables as arrays of C."""
    controller = designed()
    contents = {
        "SAFETY_TABLE": safety_bytes(safety_table(controller.display)),
        "IMAGE_SINGLE": build_image(controller, "float32"),
        "IMAGE_Q31": build_image(controller, "q31"),
        "IMAGE_OTHER": build_image(uncommon(controller), "float32"),
        "IMAGE_ADAPTIVE": build_image(adaptive(), "float32"),
        "IMAGE_ADAPTIVE_Q31": build_image(adaptive(), "q31"),
    }
    arrays = (
        f"static const uint8_t {name}[] = {{{','.join(map(str, content))}}};" for name, content in contents.items()
    )
    (folder / "tables.h").write_text("\n".join(arrays) + "\n")


def write_seeds(folder: Path) -> None:
    """Conversations of every kind, with each image: begun, played, pressed, late, silent, stopped, cleared, swapped."""
    folder.mkdir(exist_ok=True)
    feed = [STREAM, 10, 2, RUN, 4] * 12
    ended = [RUN, 255, RUN, 255, RUN, 255, RUN, 255, RUN, 255, CLEAR, 0, ACKNOWLEDGE, 0, OFF, 0]
    begun = [ARM, 0, START, 1]
    for image in range(5):
        for name, happens in {
            "played": [*feed, STOP, 0, RUN, 100],
            "loud": [*([STREAM, 23, 1, RUN, 4] * 20)],
            "noise": [*feed, NOISE, 200],
            "steady": [*(feed * 5), STREAM, 10, 2, NOISE, 16],
            "late": [*feed, LATE, 200, *feed],
            "silent": [*feed, SILENT, 255, SILENT, 255],
            "events": [*([EVENT, 0, *feed] * 6)],
            "raw": [RAW, 0, 0, 0, *range(96), RUN, 20, *feed],
            "far": [STREAM, 5, 4, RUN, 8, STREAM, 5, 8, *([STREAM, 5, 2] * 8)],
        }.items():
            (folder / f"{name}-{image}").write_bytes(bytes([1, image, *begun, *happens, *ended, IMAGE, 0, 128 + image]))
        driven = [ARM, 0, START, 12 + 1, *([STREAM, 11, 1, RUN, 4] * 20), RAW, 0, 0, 0, *([255] * 96), RUN, 20]
        (folder / f"driven-{image}").write_bytes(bytes([2, image, *driven, *ended]))
        not_a_number = [ARM, 0, START, 12 + 1, *([STREAM, 0, 0, RUN, 4] * 3), RAW, 0, 0, 0, *([255] * 96), RUN, 20]
        (folder / f"not-a-number-{image}").write_bytes(bytes([4, image, *not_a_number, *ended]))
        tones = [TONES, 0, 30, 60, 2, 40, 31, 60, 2, 40, 32, 60, 2, 40, ARM, 0, START, 2, RUN, 255, STOP, 0, *ended]
        (folder / f"tones-{image}").write_bytes(bytes([3, image, *tones]))
        held = [ARM, 0, START, 16, *feed, RUN, 100, START, 32, *feed, STOP, 0, RUN, 255, *ended]
        (folder / f"held-{image}").write_bytes(bytes([5, image, *held]))
        drawn = ([SAFETY, 0, 1, IMAGE, 0, 128 + image, *begun, *feed, EVENT, 0, *feed, *ended]) * 4
        for seed in range(12):  # tables and images of every form are drawn
            (folder / f"drawn-{image}-{seed}").write_bytes(bytes([seed, image, *drawn]))
        stopped = ([SAFETY, 0, 1, IMAGE, 0, image, *begun, *feed, STOP, 0, RUN, 255, RUN, 255, CLEAR, 0, OFF, 0]) * 4
        for seed in range(4):  # delays of several samples, which a fade leaves behind
            (folder / f"stopped-{image}-{seed}").write_bytes(bytes([seed, image, *stopped]))


def build(folder: Path, flags: list[str], program: Path) -> None:
    clang = shutil.which("clang")
    assert clang, "clang is missing: make test installs it"
    sources = [str(path) for part in PARTS for path in sorted((ROOT / "core" / part).glob("*.c"))]
    common = ["-std=c99", "-g", "-ffp-contract=off", "-I", str(ROOT / "core"), "-I", str(folder)]
    subprocess.run(
        [clang, *common, *flags, str(ROOT / "tests/fuzz/period.c"), *sources, "-lm", "-o", program], check=True
    )


def fuzz(folder: Path, *options: str) -> tuple[Path, int]:
    """The corpus after a run with these options, and how many steps of the period it took."""
    program, corpus = folder / "fuzz-period", folder / "corpus"
    write_tables(folder)
    write_seeds(corpus)
    sanitisers = "-fsanitize=fuzzer,address,undefined,float-cast-overflow"
    build(folder, ["-O1", sanitisers, "-fno-sanitize-recover=all"], program)
    limits = ["-max_len=2048", "-seed=1", "-rss_limit_mb=4096", "-print_final_stats=1"]
    done = subprocess.run([program, corpus, *limits, *options], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return corpus, int(re.findall(r"steps of the period: (\d+)", done.stderr)[-1])


def uncovered(folder: Path, corpus: Path) -> dict[str, list[int]]:
    """Lines of the production path that no input of the corpus comes by."""
    program, profile = folder / "cover-period", folder / "period.profraw"
    build(folder, ["-O0", "-fsanitize=fuzzer", "-fprofile-instr-generate", "-fcoverage-mapping"], program)
    subprocess.run(
        [program, "-runs=0", corpus],
        cwd=folder,
        env={"LLVM_PROFILE_FILE": str(profile)},
        capture_output=True,
        check=True,
    )
    subprocess.run(["llvm-profdata", "merge", "-o", folder / "period.profdata", profile], check=True)
    paths = [str(ROOT / "core" / name) for name in COVERED]
    shown = subprocess.run(
        ["llvm-cov", "show", program, f"-instr-profile={folder / 'period.profdata'}", *paths],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    missed: dict[str, list[int]] = {}
    name = ""
    for line in shown.splitlines():
        if line.endswith(":") and "/core/" in line:
            name = line.split("/core/")[1].rstrip(":")
            missed[name] = []
        elif (found := re.match(r"\s*(\d+)\|\s*0\|", line)) is not None:
            missed[name].append(int(found[1]))
    return missed


@pytest.mark.slow
def test_period__some_seconds_of_fuzzing__break_nothing(tmp_path: Path) -> None:
    _, steps = fuzz(tmp_path, "-max_total_time=5")
    assert steps > 10_000


@pytest.mark.soak
def test_period__hundred_million_steps__break_nothing_and_come_by_every_line(tmp_path: Path) -> None:
    taken, folder = 0, tmp_path
    while taken < 100_000_000:
        corpus, steps = fuzz(folder, "-max_total_time=600")
        taken += steps
    assert uncovered(folder, corpus) == {name: [] for name in COVERED}

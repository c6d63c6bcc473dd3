"""The interrupt's path under libFuzzer and sanitisers, with invariants of what is put out."""

import re
from pathlib import Path

import pytest

from tactuator.rig.board.commissioning import safety_table
from tactuator.runtime.image import build_image
from tactuator.runtime.safety_table import safety_bytes
from tactuator.runtime.tables import simulated_board_bytes
from tests.firmware.drawn import drawn
from tests.fuzz.conftest import fuzz
from tests.rig.guard.guarded import adaptive, designed, spoilt

DRAWN = 24
"""Cases of each kind of controller, whose tables are swapped in."""
CLEAR, ARM, START, STOP, OFF, ACKNOWLEDGE, STREAM, RUN, NOISE, SILENT, LATE, IMAGE, SAFETY, TONES, EVENT, RAW = range(
    16
)


def write_tables(folder: Path) -> None:
    usual = (designed(), spoilt(designed(), 0.5), adaptive())
    cases = [drawn(seed, of) for seed in range(DRAWN) for of in (designed(), adaptive())]
    images = [(build_image(of), 1) for of in usual] + [(case.image, case.safety.delay_samples) for case in cases]
    safeties = [(safety_bytes(table), 0) for table in (safety_table(designed().display), *(c.safety for c in cases))]
    lines = [array("DISPLAY", simulated_board_bytes(designed().display, 1))]
    for name, files in (("IMAGE", images), ("SAFETY", safeties)):
        lines += [array(f"{name}_{at}", content) for at, (content, _) in enumerate(files)]
        entries = (f"{{{name}_{at}, {len(content)}, {delay}}}" for at, (content, delay) in enumerate(files))
        lines.append(f"static const file {name}_FILES[] = {{{', '.join(entries)}}};")
    (folder / "tables.h").write_text("\n".join(lines) + "\n")


def array(name: str, content: bytes) -> str:
    return f"static const uint8_t {name}[] = {{{','.join(map(str, content))}}};"


def conversations(drawn_seeds: int) -> dict[str, bytes]:
    """Of every kind, with each image: begun, played, pressed, late, silent, stopped, cleared, swapped; drawn ones."""
    seeds: dict[str, bytes] = {}
    feed = [STREAM, 10, 2, RUN, 4] * 12
    ended = [RUN, 255, RUN, 255, RUN, 255, RUN, 255, RUN, 255, CLEAR, 0, ACKNOWLEDGE, 0, OFF, 0]
    begun = [ARM, 0, START, 1]
    for image in range(3):
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
            seeds[f"{name}-{image}"] = bytes([1, image, *begun, *happens, *ended, IMAGE, 0, 128 + image])
        driven = [ARM, 0, START, 12 + 1, *([STREAM, 11, 1, RUN, 4] * 20), RAW, 0, 0, 0, *([255] * 96), RUN, 20]
        seeds[f"driven-{image}"] = bytes([2, image, *driven, *ended])
        not_a_number = [ARM, 0, START, 12 + 1, *([STREAM, 0, 0, RUN, 4] * 3), RAW, 0, 0, 0, *([255] * 96), RUN, 20]
        seeds[f"not-a-number-{image}"] = bytes([4, image, *not_a_number, *ended])
        tones = [TONES, 0, 30, 60, 2, 40, 31, 60, 2, 40, 32, 60, 2, 40, ARM, 0, START, 2, RUN, 255, STOP, 0, *ended]
        seeds[f"tones-{image}"] = bytes([3, image, *tones])
        held = [ARM, 0, START, 16, *feed, RUN, 100, START, 32, *feed, STOP, 0, RUN, 255, *ended]
        seeds[f"held-{image}"] = bytes([5, image, *held])
        drawn = ([SAFETY, 0, 1, IMAGE, 0, 128 + image, *begun, *feed, EVENT, 0, *feed, *ended]) * 4
        for seed in range(drawn_seeds):  # tables and images of every form are drawn
            seeds[f"drawn-{image}-{seed}"] = bytes([seed, image, *drawn])
        stopped = ([SAFETY, 0, 1, IMAGE, 0, image, *begun, *feed, STOP, 0, RUN, 255, RUN, 255, CLEAR, 0, OFF, 0]) * 4
        for seed in range(drawn_seeds // 3):  # delays of several samples, which a fade leaves behind
            seeds[f"stopped-{image}-{seed}"] = bytes([seed, image, *stopped])
    return seeds


def fuzzed(folder: Path, objects: list[Path], until: str, drawn_seeds: int = 12) -> int:
    """How many steps of the period were taken until then."""
    write_tables(folder)
    said = fuzz(folder, "period", objects, conversations(drawn_seeds), 2048, until)
    return int(re.findall(r"steps of the period: (\d+)", said)[-1])


@pytest.mark.slow
def test_period__fuzzed_conversations__break_nothing(tmp_path: Path, objects: list[Path]) -> None:
    assert fuzzed(tmp_path, objects, "-runs=120", drawn_seeds=3) > 10_000

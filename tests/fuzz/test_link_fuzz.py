"""The link's decoder and everything behind it under libFuzzer, address and undefined-behaviour sanitisers.

It starts from whole conversations (seeds.py), with tables, images and displays whose checksums link.c puts right.
"""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.fuzz.seeds import write_seeds

ROOT = Path(__file__).resolve().parents[2]
LEFT_OUT = ("host", "display/closed_loop")


def fuzz(folder: Path, seconds: int) -> str:
    """Build the fuzzer, run it for so long, and give what it says."""
    clang = shutil.which("clang")
    assert clang, "clang is missing: make test installs it"
    core = ROOT / "core"
    parts = sorted(str(path.relative_to(core)) for path in core.rglob("*.c"))
    sources = [str(core / part) for part in parts if not part.startswith(LEFT_OUT)]
    program, corpus = folder / "fuzz-link", folder / "corpus"
    write_seeds(corpus)
    flags = ["-std=c99", "-O1", "-g", "-ffp-contract=off", "-fsanitize=fuzzer,address,undefined,float-cast-overflow"]
    flags += ["-fno-sanitize-recover=all", "-I", str(ROOT / "core")]
    subprocess.run([clang, *flags, str(ROOT / "tests/fuzz/link.c"), *sources, "-o", program], check=True)
    options = [f"-max_total_time={seconds}", "-max_len=4096", "-seed=1", "-print_final_stats=1"]
    options += ["-rss_limit_mb=4096"]
    done = subprocess.run([program, corpus, *options], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stderr


@pytest.mark.slow
def test_link__twenty_seconds_of_fuzzing__break_nothing(tmp_path):
    said = fuzz(tmp_path, 20)
    runs = next(line for line in said.splitlines() if "number_of_executed_units" in line)
    assert int(runs.split()[-1]) > 1000


@pytest.mark.soak
def test_link__an_hour_of_fuzzing__breaks_nothing(tmp_path):
    fuzz(tmp_path, 3600)

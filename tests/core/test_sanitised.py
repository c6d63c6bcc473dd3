"""The core's loops compiled with the address and undefined-behaviour sanitisers."""

import shlex
import subprocess
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ARITHMETIC = (
    "arithmetic/converter arithmetic/finite arithmetic/float_pair arithmetic/noise arithmetic/section "
    "control/controller control/controller_q31 arithmetic/section_q31 "
    "touch/table touch/learning touch/feed_forward touch/adaptive_controller"
)
DISPLAY = "display/closed_loop display/display display/friction display/hum display/plant"
LANES = "lanes/lanes lanes/lanes_baseline lanes/lanes_avx2 lanes/lanes_avx512"


def test_loops__hostile_numbers__nothing_undefined_and_nothing_out_of_bounds(tmp_path: Path) -> None:
    run_sanitised(tmp_path, "-DTACT_LANES_BASELINE_ONLY")


@pytest.mark.soak
def test_loops__hostile_numbers_in_the_widest_vectors__nothing_undefined(tmp_path: Path) -> None:
    run_sanitised(tmp_path)


def run_sanitised(tmp_path: Path, *options: str) -> None:
    sources = [ROOT / "core" / f"{name}.c" for name in f"{ARITHMETIC} {DISPLAY} {LANES}".split()]
    compiler = shlex.split(sysconfig.get_config_var("CC") or "cc")[0]
    # not optimised: the lanes then compile in half the time, and no undefined operation is optimised away
    flags = "-std=c99 -O0 -g1 -ffp-contract=off -Wall -Wextra -Werror -fno-sanitize-recover=all"
    sanitisers = "-fsanitize=address,undefined,float-cast-overflow"
    program = tmp_path / "sanitised"
    command = [
        compiler,
        *flags.split(),
        *options,
        sanitisers,
        "-I",
        ROOT / "core",
        ROOT / "tests/core/sanitised.c",
        *sources,
    ]
    subprocess.run([*command, "-o", program], check=True)
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "sound\n"), done.stderr

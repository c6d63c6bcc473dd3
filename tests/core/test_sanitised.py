"""The core's loops compiled with the address and undefined-behaviour sanitisers."""

import shlex
import subprocess
import sysconfig
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ARITHMETIC = (
    "arithmetic/converter arithmetic/finite arithmetic/float_pair arithmetic/noise arithmetic/section "
    "control/controller control/controller_q31 arithmetic/section_q31 "
    "touch/table touch/learning touch/feed_forward touch/adaptive_controller strength/strength"
)
DISPLAY = "display/closed_loop display/display display/friction display/hum display/plant"


def test_loops__hostile_numbers__nothing_undefined_and_nothing_out_of_bounds(tmp_path: Path) -> None:
    sources = [ROOT / "core" / f"{name}.c" for name in f"{ARITHMETIC} {DISPLAY}".split()]
    compiler = shlex.split(sysconfig.get_config_var("CC") or "cc")[0]
    # not optimised: no undefined operation is optimised away
    flags = "-std=c99 -O0 -g1 -ffp-contract=off -Wall -Wextra -Werror -fno-sanitize-recover=all"
    sanitisers = "-fsanitize=address,undefined,float-cast-overflow"
    program = tmp_path / "sanitised"
    command = [compiler, *flags.split(), sanitisers, "-I", ROOT / "core", ROOT / "tests/core/sanitised.c", *sources]
    subprocess.run([*command, "-o", program], check=True)
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "sound\n"), done.stderr

"""What a reference that is reshaped by its level costs a board: instructions of a sample of one channel, by QEMU.

The core's own file is compiled as for the board's firmware, with a program around it that is this file's own and looks
at SysTick before and after every sample; an instruction takes 1024 ns of the emulator's time. The table is that of
Griffin's law on the example display, what comes in is silence, then tones that begin, at every level. Seen to fail
(nothing is counted): with --empty the step is left out.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from tactuator.rig.boards import COMPILER, FLAGS, ROOT, find_board
from tactuator.rig.emulator import emulator_command
from tactuator.rig.period_cost import COUNTING, INSTRUCTION_S
from tactuator.runtime.image import strength_bytes
from tests.runtime.paper_display import RATE_HZ, controller, display
from tests.strength import reshaped

CORTEX_M = tuple(f"firmware/cortex_m/{name}.c" for name in ("interrupts", "startup", "systick"))
FILES = ("core/strength/strength.c", *CORTEX_M, "firmware/mps2/semihosting.c", "firmware/mps2/vectors.c")
SILENT, SAMPLES = 400, 4000
PROGRAM = """
#include "cortex_m/systick.h"
#include "mps2/semihosting.h"
#include "port.h"
#include "strength/strength.h"
void tact_port_outputs_safe(void) {{}}
static tact_strength table = {{1, {table}}};
static const float rows[] = {{{rows}}};
enum {{ SAMPLES = sizeof rows / sizeof *rows, WHOLE = 0xffffff }};
static uint32_t counts[SAMPLES];
volatile float out;
int main(void)
{{
    tact_strength_state state;
    const int file = tact_host_open("counts", 1);
    tact_strength_reset(&state);
    tact_systick_count();
    uint32_t before = tact_systick_left();
    const uint32_t looked = (before - tact_systick_left()) & WHOLE;
    for (int i = 0; i < SAMPLES; i++) {{
        before = tact_systick_left();
        {step};
        counts[i] = ((before - tact_systick_left()) & WHOLE) - looked;
    }}
    tact_host_write(file, (const uint8_t *)counts, sizeof counts);
    tact_host_exit();
    return 0;
}}
"""


def listed(values: np.ndarray) -> str:
    return ", ".join(f"{float(value).hex()}f" for value in values)


def counted(name: str, empty: bool) -> np.ndarray:
    """Return the instructions of every sample."""
    board, (channel, *_) = find_board(name), reshaped(controller(display())).channels
    time_s = np.arange(SAMPLES - SILENT) / RATE_HZ
    level = np.repeat(np.linspace(0.0, 55.0, 12), time_s.size // 12)[: time_s.size]
    tone = 10.0 ** (np.resize(level, time_s.size) / 20.0) * np.sin(2.0 * np.pi * 90.0 * time_s)
    step = "out = 0.0f" if empty else "out = tact_strength_step(&table, &state, rows[i])"
    words = listed(np.frombuffer(strength_bytes(channel, RATE_HZ), dtype="<f4"))
    text = PROGRAM.format(table=words, rows=listed(np.r_[np.zeros(SILENT), tone].astype(np.float32)), step=step)
    with tempfile.TemporaryDirectory() as folder:
        source, program = Path(folder) / "main.c", Path(folder) / "main.elf"
        source.write_text(text, encoding="utf-8")
        where = f"-mcpu={board.processor}", f"-mfpu={board.floating_point}", "-Wno-missing-braces"
        script = "-T", f"firmware/{board.folder}/{board.script}"
        command = [
            COMPILER,
            *FLAGS,
            *where,
            "-Icore",
            "-Ifirmware",
            *FILES,
            str(source),
            *script,
            "-lgcc",
            "-o",
            str(program),
        ]
        subprocess.run(command, cwd=ROOT, check=True)
        subprocess.run(emulator_command(name, program, COUNTING), cwd=folder, check=True, timeout=120)
        counts = np.fromfile(Path(folder) / "counts", dtype="<u4")
    return np.asarray(np.round(counts / (INSTRUCTION_S * board.timer_hz)), dtype=int)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--board", default="mps2-an386")
    parser.add_argument("--empty", action="store_true", help="without the step: seen to fail")
    asked = parser.parse_args()
    each = counted(asked.board, asked.empty)
    silent, sounding = each[:SILENT], each[SILENT:]
    for name, of in (("in silence", silent), ("with tones", sounding)):
        print(f"{asked.board}, {name}: {of.min()} to {of.max()} instructions a sample, {of.mean():.0f} in the mean")
    return 0 if sounding.min() > 100 else 1


if __name__ == "__main__":
    sys.exit(main())

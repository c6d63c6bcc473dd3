"""Are the codes those of the published rebuild? `python -m witnesses.taps.published FOLDER` of a checkout of
google/audio-to-tactile compiles its phoneme_code.c and compares every tactor of every code, up to a gain of each.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from tactuator.speech.taps import CODES, TACTORS, duration_s

RATE_HZ = 12000.0
LEAST = 0.995
"""The last taps of OW and OY end at 0.4007 s there, and are cut at 0.4 s."""
CALL = """
#include "extras/references/taps/phoneme_code.h"
float* generate(const char* name, float rate, int* frames) {
  return GeneratePhonemeSignal(name, 0.0f, 0, 1.0f, rate, frames);
}
"""


def compiled(folder: Path, into: Path) -> ctypes.CDLL:
    (into / "call.c").write_text(CALL)
    sources = [str(folder / "extras/references/taps/phoneme_code.c"), str(folder / "extras/tools/util.c")]
    command = ["cc", "-std=gnu99", "-O1", "-shared", "-fPIC", f"-I{folder}", *sources, str(into / "call.c"), "-lm"]
    subprocess.run([*command, "-Wl,--unresolved-symbols=ignore-all", "-o", str(into / "taps.so")], check=True)
    return ctypes.CDLL(str(into / "taps.so"))


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        library = compiled(Path(sys.argv[1]), Path(name))
        library.generate.restype = ctypes.POINTER(ctypes.c_float)
        library.generate.argtypes = [ctypes.c_char_p, ctypes.c_float, ctypes.POINTER(ctypes.c_int)]
        worst, wrong = 1.0, []
        for phoneme, code in CODES.items():
            frames = ctypes.c_int()
            samples = library.generate(phoneme.encode(), RATE_HZ, ctypes.byref(frames))
            theirs = np.ctypeslib.as_array(samples, (frames.value, TACTORS))
            ours = np.zeros((round(duration_s(phoneme) * RATE_HZ) + 2, TACTORS))
            for burst in code:
                start, wave = burst.wave(RATE_HZ, burst.carrier_hz)
                ours[start : start + wave.size, list(burst.tactors)] += wave[:, None]
            length = min(len(ours), len(theirs))
            active = {n for n in range(TACTORS) if np.any(theirs[:, n])}
            alike = [
                float(
                    np.dot(ours[:length, n], theirs[:length, n])
                    / np.linalg.norm(ours[:, n])
                    / np.linalg.norm(theirs[:, n])
                )
                for n in sorted(active)
            ]
            worst = min(worst, *alike)
            if active != {n for burst in code for n in burst.tactors} or min(alike) < LEAST:
                wrong.append((phoneme, min(alike)))
    print(f"{len(CODES)} codes, least likeness {worst:.5f}; wrong: {wrong or 'none'}")
    raise SystemExit(bool(wrong))


if __name__ == "__main__":
    main()

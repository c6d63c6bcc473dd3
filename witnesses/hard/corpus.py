"""Corrupts every file of a rendered corpus without changing its size, and lets the program go on with the corpus.

Every corrupted file has to be found and rendered again, with the bytes it had, and every file that was let alone has to
be kept. Not shared with the program: the damage, and the checksums from before. Seen to fail with `--broken size`
(the program compares sizes only).
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import sys
import tempfile
from pathlib import Path

import numpy as np
import soundfile

from tactuator.corpus import corpus, task
from tactuator.corpus.corpus import CorpusResult, run_corpus
from tactuator.corpus.workers import Here
from tactuator.io.display import read_display
from tactuator.speech.band_codings import DirectCoding
from tactuator.speech.render import RenderJob
from tactuator.synthesis.design import design_controller
from witnesses.hard.readers import EXAMPLES

UNTOUCHED = 10


def _speak(folder: Path, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for number in range(count):
        wave = rng.standard_normal(8000) * np.repeat([0.1, 0.01, 0.1, 0.01], 2000)
        soundfile.write(folder / f"word{number:03}.wav", wave, 16000)


def _sums(out: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(out.glob("word*"))}


def _corrupt(path: Path, number: int, rng: random.Random) -> None:
    """Change the file in one of three ways, its size and its time of change as before."""
    stat, content = path.stat(), bytearray(path.read_bytes())
    before = bytes(content)
    while bytes(content) == before:
        at = rng.randrange(len(content))
        if number % 3 == 0:
            content[at] ^= 1 << rng.randrange(8)
        elif number % 3 == 1:
            content[at : at + 512] = bytes(len(content[at : at + 512]))
        else:
            content[at : at + 512] = rng.randbytes(len(content[at : at + 512]))
    path.write_bytes(content)
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def _only_size(path: Path) -> list[str]:
    return [str(path.stat().st_size)]


def main() -> int:
    """Run the witness, and return its exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=100, help="files that are corrupted")
    parser.add_argument("--broken", choices=["size"])
    given = parser.parse_args()
    job = RenderJob(design_controller(read_display(EXAMPLES / "displays/tactuator.toml")), DirectCoding())
    rng = random.Random(given.seed)
    with tempfile.TemporaryDirectory() as place:
        folder, out = Path(place) / "speech", Path(place) / "out"
        folder.mkdir()
        _speak(folder, given.count + UNTOUCHED, given.seed)

        def run() -> CorpusResult:
            return run_corpus(folder, out, job, Here())

        if given.broken:
            setattr(task, "written_sha256", _only_size)  # noqa: B010
            setattr(corpus, "written_sha256", _only_size)  # noqa: B010
        run()
        whole = _sums(out)
        for number, path in enumerate(sorted(out.glob("word*.wav"))[: given.count]):
            # half of the references are corrupted in the file of their scale
            _corrupt(path if number % 2 == 0 else path.with_suffix(".json"), number // 2, rng)
        corrupted = sum(whole[name] != now for name, now in _sums(out).items())
        again = run()
        wrong = sum(whole[name] != now for name, now in _sums(out).items())
    print(f"{corrupted} corrupted; {again.done} rendered again, {again.kept} kept, {wrong} still wrong")
    return int((corrupted, again.done, again.kept, wrong) != (given.count, given.count, UNTOUCHED, 0))


if __name__ == "__main__":
    sys.exit(main())

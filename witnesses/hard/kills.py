"""Kills a program that answers trials into a store, a thousand times, and compares the store with what it had told.

Not shared with the store: the killer's own list of answers, kept from the pipe, and SQLite's own reading of the file.
Seen to fail with `--broken early` (an answer told before it is stored: lost) and with `--broken deaf` (another answer
stored: changed).
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from pathlib import Path

from witnesses.hard.sitting import Broken, Sittings, warm


def main() -> int:
    """Run the witness, and return its exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=1000, help="kills")
    parser.add_argument("--answers", type=int, default=50_000, help="answers in all, at least")
    parser.add_argument("--broken", choices=["early", "deaf"])
    given = parser.parse_args()
    rng = random.Random(given.seed)
    warm()
    each = given.answers / given.count
    with tempfile.TemporaryDirectory() as folder:
        broken = Broken(**{given.broken: True}) if given.broken else Broken()
        sittings = Sittings(Path(folder) / "lab.db", given.seed, broken, [])
        while sittings.begun < given.count or len(sittings.told) < given.answers:
            sittings.until_killed(round(rng.uniform(0.0, 2.0 * each)), rng.uniform(0.0, 0.02))
            if sittings.begun % 50 == 0:
                sys.stderr.write(f"\r{sittings.begun} kills, {len(sittings.told)} answers")
        faults = sittings.faults()
    print(f"\n{sittings.begun} kills, {len(sittings.told)} answers told", faults)
    return int(any(faults.values()))


if __name__ == "__main__":
    sys.exit(main())

"""Fingers on one frame: is their coupling found, and is what one feels of another what `check` says?

The display, its record and its closed loop are frame.py's, which uses nothing of the program; the threshold curve is
this file's. `identify`, `design` and `check` run as commands, and pass files to each other as a user would. Seen to
fail with --ignore: the channels are identified one by one, and the display file tells of no coupling.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from witnesses.coupling import frame

LEVELS_DB, DRIVEN_DB_SL = (-20.0, -30.0, -40.0), 50.0
MOST_SHARE_DB, MOST_FELT_DB = 1.0, 0.5
FORM = ("--order", "4", "--zeros", "2")
"""What a user knows of a mover on a frame: two resonances, and a force that accelerates it."""
CURVE = (
    (1.0, 31.0),
    (4.0, 24.0),
    (10.0, 19.0),
    (25.0, 10.0),
    (60.0, 0.0),
    (120.0, -9.0),
    (250.0, -13.0),
    (300.0, -12.0),
)


@dataclass
class Figures:
    """What a display showed: greatest errors of the told shares and felt levels (dB), how many there were of each, and
    the share of the shares' lines that lie in their 95 % disks."""

    share_error_db: float
    felt_error_db: float
    pairs: int
    felt: int
    inside: float
    outcome: str


def run(folder: Path, *arguments: str) -> dict[str, Any]:
    """Return the JSON of a command, which may end with a verdict of no."""
    command = [sys.executable, "-m", "tactuator", *arguments, "--json"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(arguments)}: status {done.returncode}: {done.stderr}")
    return dict(json.loads(done.stdout))


def display_file(folder: Path, *, coupled: bool, loop: str = "integrator-lead-lag") -> None:
    """Write the display file of the identified fingers; loop: the structure of C, "paper" where it is given."""
    (folder / "curve.csv").write_text(
        "frequency_hz,level_db_re_1um\n" + "".join(f"{f},{level}\n" for f, level in CURVE)
    )
    text = f'[display]\nrate_hz = {frame.RATE_HZ}\n[threshold]\ncurve = "curve.csv"\nband_hz = [2.0, 250.0]\n'
    text += f'[objectives]\ncomfort_db_sl = {DRIVEN_DB_SL}\n[feedback]\nstructure = "{loop}"\n'
    text += f"[environment]\nhum_hz = []\nhum_v_peak = []\nnoise_v_rms = {frame.NOISE_V}\n"
    text += f"friction_v = {frame.FRICTION_V}\npresliding_v = {frame.PRESLIDING_V}\n"
    text += '[coupling]\nmeasured = "fingers.json"\n' if coupled else ""
    for name, gain in zip(frame.NAMES, frame.GAIN_V_PER_MM, strict=True):
        text += f'[[channel]]\nname = "{name}"\nsensor_gain_v_per_mm = {gain}\ntravel_mm = 12.5\n'
        text += f'plant = "fingers-{name}.json"\n'
    (folder / "display.toml").write_text(text)


def identified(folder: Path, *, ignored: bool) -> list[dict[str, Any]]:
    """Identify record.h5 of a folder, and return what is told of the pairs; or identify each channel as if the others
    were not there."""
    if not ignored:
        told = run(folder, "identify", "record.h5", *FORM, "--out", "fingers.json")
        return list(told["coupling"]["pairs"])
    for place, name in enumerate(frame.NAMES, 1):
        columns = ("--input", f"command.{place}", "--output", f"position.{place}")
        run(folder, "identify", "record.h5", *FORM, *columns, "--out", f"fingers-{name}.json")
    return []


def share_errors(folder: Path, mass: float, pairs: list[dict[str, Any]]) -> tuple[list[float], float]:
    """Return the errors (dB) of every pair's greatest share, against the mean power of the third octave around, and the
    share of the lines within their disks."""
    told = json.loads((folder / "fingers.json").read_text())
    lines = np.array(told["frequency_hz"])
    value = np.array(told["real"]) + 1j * np.array(told["imag"])
    ahead = np.einsum("mii->mi", value)[:, :, None]
    off = np.abs(value / ahead - frame.shares(mass, lines)) < 1.731 * np.array(told["deviation"]) / np.abs(ahead)
    inside = off[:, ~np.eye(3, dtype=bool)]
    errors = []
    for pair in pairs:
        near = pair["frequency_hz"] * 2.0 ** np.linspace(-1.0 / 6.0, 1.0 / 6.0, 41)
        place = frame.NAMES.index(pair["channel"]), frame.NAMES.index(pair["driver"])
        power = np.mean(np.abs(frame.shares(mass, near)[:, *place]) ** 2)
        errors.append(pair["share_db"] - 10.0 * float(np.log10(power)) if pair["is_seen"] else np.inf)
    return errors, float(np.mean(inside))


def felt_errors(folder: Path, mass: float, seed: int) -> tuple[list[float], str]:
    """Return the errors (dB) of every finding of crosstalk against the simulated loops, and the stability's outcome; a
    finding that is missing errs without bound."""
    verdict = run(folder, "check", "controller.json", "--display", "display.toml")
    findings = verdict["objectives"].get("v", {"findings": []})["findings"]
    errors, outcome = [], "not judged"
    for finding in findings:
        if finding["quantity"] != "felt crosstalk":
            outcome = finding["outcome"]
            continue
        driver, place = finding["remark"].split()[1], frame.NAMES.index(finding["channel"])
        at_hz, peak = finding["frequency_hz"], 10.0 ** (DRIVEN_DB_SL / 20.0)
        moved = frame.felt_v(folder / "controller.json", mass, frame.NAMES.index(driver), peak, at_hz, seed)
        threshold = np.interp(np.log(at_hz), np.log([f for f, _ in CURVE]), [level for _, level in CURVE])
        level = 20.0 * np.log10(1e3 * moved[place] / frame.GAIN_V_PER_MM[place]) - threshold
        errors.append(finding["value"] - float(level))
    return errors or [np.inf], outcome


def judged(folder: Path, level_db: float, seed: int, period_s: float, *, ignored: bool = False) -> Figures:
    """Return what a display with a coupling of that level showed."""
    mass = frame.mass_for(level_db)
    frame.write_record(folder / "record.h5", mass, seed, period_s, 6)
    pairs = identified(folder, ignored=ignored)
    display_file(folder, coupled=not ignored)
    run(folder, "design", "display.toml", "--out", "controller.json")
    shares, inside = ([np.inf], 0.0) if ignored else share_errors(folder, mass, pairs)
    felt, outcome = felt_errors(folder, mass, seed + 1)
    worst, loudest = (float(np.max(np.abs(each))) for each in (shares, felt))
    return Figures(worst, loudest, len(shares), len(felt), inside, outcome)


def main() -> int:
    """Print the worst errors at each level; return 0 where all are kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--period-s", type=float, default=6.0, help="of the record's multisines, 18 periods in all")
    parser.add_argument("--level", type=float, choices=LEVELS_DB, help="this one alone")
    parser.add_argument("--ignore", action="store_true", help="identify as if nothing were coupled: broken")
    given = parser.parse_args()
    kept = []
    print("level (dB)  share off (dB)  lines in 95 %  felt off (dB)  loops together")
    for level in LEVELS_DB if given.level is None else (given.level,):
        with tempfile.TemporaryDirectory() as name:
            seen = judged(Path(name), level, given.seed, given.period_s, ignored=given.ignore)
        kept.append(seen.share_error_db <= MOST_SHARE_DB and seen.felt_error_db <= MOST_FELT_DB)
        figures = (
            f"{seen.share_error_db:9.2f} of {seen.pairs}  {seen.inside:13.3f}  {seen.felt_error_db:8.2f} of {seen.felt}"
        )
        print(f"{level:10.0f}  {figures}  {seen.outcome:>14}", flush=True)
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())

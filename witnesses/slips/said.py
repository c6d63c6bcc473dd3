"""What each verb says of files with one slip, and of right files: .venv/bin/python -m witnesses.slips.said [--right]

The files are written by `setups.py`, which shares nothing with the project. A slip is caught where a verb that sees it
says the word for it and none ends in "met"; a right file passes where no verb doubts its numbers. It was seen to fail:
with the bounds of `model/plausibility.py` taken away, 36 of 45 slips are not named. Ends with 1 where a slip passes, or
where right files are doubted.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from tactuator.cli.main import main as tactuator
from witnesses.slips.setups import RIGHT, SLIPS, Slip


@dataclass(frozen=True)
class Said:
    """One verb's exit status and all that it wrote."""

    verb: str
    status: int
    text: str

    @property
    def is_met(self) -> bool:
        """Tell whether its verdict is that everything is met."""
        return bool(re.search(r"^verdict: met", self.text, re.MULTILINE))

    @property
    def doubts(self) -> bool:
        """Tell whether it doubts the numbers of its files."""
        return bool(re.search(r"numbers, |note: .*expected|not to be trusted|another reading|swapped", self.text))


def said_of(slip: Slip, folder: Path, measured: bool = False) -> Iterator[Said]:
    """Yield what each verb of the chain says of the files, as far as the chain comes; measured: at a rig, too."""
    setup, written = slip.setup, slip.written
    written.files(setup, folder)
    display, model, controller = (str(folder / name) for name in ("display.toml", "model.json", "controller.json"))
    if written.pairs is not None:
        pairs = _run("calibrate", str(folder / "pairs.csv"))
        yield pairs
        gain = re.search(r"gain \(V/mm\)\W+([\d.e+-]+)", pairs.text)
        if gain is not None:
            written = replace(written, gain=float(gain[1]) / setup.gain_v_per_mm)
            written.files(setup, folder)
    if written.plant != "inline":
        source = str(folder / f"{written.plant}.csv")
        order = ["--order", "2", "--no-friction"] if written.plant == "record" else []
        quantity = ["--quantity", setup.quantity]
        yield _run("identify", source, *order, *quantity, "--out", model)
    if written.plant == "record" and not Path(model).exists():
        return
    yield _run("design", display, "--out", controller)
    if Path(controller).exists():
        yield _run("check", controller)
        if measured:
            points = ["--frequency-hz", "40,100", "--level", "5", "--confidence-db", "1"]
            yield _run("measure", "--controller", controller, *points)
            yield _run("noise", "--controller", controller, "--duration-s", "4")


def _run(*arguments: str) -> Said:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = tactuator(list(arguments))
    return Said(arguments[0], status, out.getvalue() + err.getvalue())


def faults(slip: Slip, said: list[Said]) -> list[str]:
    """Return what is wrong with what was said of a slip; empty where it is caught."""
    wrong = [f"{each.verb} ends in met" for each in said if each.is_met]
    wrong += [f"{each.verb} fails with {each.status}" for each in said if each.status not in (0, 1, 2)]
    if not any(slip.words in each.text for each in said):
        wrong.append(f"nobody says {slip.words!r}")
    if not any(each.status or each.doubts for each in said):
        wrong.append("every verb exits 0 without a word")
    return wrong


def alarms(said: list[Said]) -> list[str]:
    """Return what was said against right files: doubts of their numbers, and refusals."""
    return [f"{each.verb}: {_words(each)}" for each in said if each.doubts or each.status not in (0, 1)]


def _words(said: Said) -> str:
    """Return the line that says most of what a verb said."""
    pattern = r"numbers, |expected|trusted:|tactuator: |swapped|against the"
    lines = [line for line in said.text.splitlines() if re.search(pattern, line)]
    verdict = (line for line in said.text.splitlines() if "verdict" in line)
    return lines[-1][:110] if lines else next(verdict, "")


def main() -> int:
    """Print the table, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--right", action="store_true", help="right files in place of slips")
    parser.add_argument("--measure", action="store_true", help="at the simulated rig, too")
    parser.add_argument("--only", default="", help="those whose name holds this")
    asked = parser.parse_args()
    bad = 0
    for slip in RIGHT if asked.right else SLIPS:
        if asked.only not in slip.name:
            continue
        with tempfile.TemporaryDirectory() as folder:
            said = list(said_of(slip, Path(folder), asked.measure))
            where = folder
        wrong = alarms(said) if asked.right else faults(slip, said)
        bad += bool(wrong)
        print(f"{'NO ' if wrong else 'yes'} {slip.name}", *(f"\n      -- {each}" for each in wrong))
        for each in said:
            print(f"      {each.verb} {each.status}: {_words(each).replace(where + '/', '')}")
        sys.stdout.flush()
    print(f"{bad} of {len(RIGHT if asked.right else SLIPS)} are not as they should be")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())

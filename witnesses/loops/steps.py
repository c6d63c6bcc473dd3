"""Draws displays with coarse converters, has each designed and checked, and runs each loop in time at 10 dB SL.

Where `check` says that objective i is kept at the lowest level, or says nothing of it, no tone may move further than
1.3 dB from what was asked, wherever the sensor rests between two codes. Not shared with the program: the plant and its
hold, the converters (NumPy's rounding), noise, hum and the level that was felt (NumPy and SciPy alone). Shared: the
display file, and the figures of `controller.json`. Seen to fail with `--without`, the verdict without that finding.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

import tactuator as tt
from tactuator.errors import BadInput, NoDesign
from tactuator.io.display import parse_display

Array = NDArray[np.float64]
CURVE = ([0.4, 3.0, 10.0, 30.0, 80.0, 250.0, 500.0], [32.0, 30.0, 24.0, 8.0, -8.0, -17.0, -8.0])
RATE_HZ, RANGE_V, LEVEL_DB_SL, HUM_HZ, HUM_V = 8000.0, 10.0, 10.0, 50.0, 0.3e-3
TONES_HZ = (6.0, 17.0, 38.0, 63.0, 88.0, 123.0, 176.0, 241.0)
RESTS = (0.0, 0.25, 0.5)
ASKED_DB, SLACK_DB = 1.0, 0.3
TABLE = """
[display]
name = "drawn"
rate_hz = {rate}
[converter]
bits = {bits}
range_v = {range_v}
[threshold]
curve = {{ name = "drawn", frequency_hz = {hertz}, level_db_re_1um = {level} }}
band_hz = [5.0, 250.0]
[feedback]
structure = "{structure}"
[prefilter]
poles = 8
[environment]
hum_hz = [{hum_hz}]
hum_v_peak = [{hum_v}]
noise_v_rms = {noise}
friction_v = 0.0
[[channel]]
name = "drawn"
sensor_gain_v_per_mm = {sensor}
travel_mm = {travel}
plant = {{ num = [{gain}], den = [1.0, {drag}, {spring}] }}
"""


def cascade(rows: list[list[float]]) -> Callable[[float], float]:
    """Return a filter of second-order sections that takes a sample and gives one."""
    states = [[0.0, 0.0] for _ in rows]

    def step(value: float) -> float:
        for (b0, b1, b2, _, a1, a2), state in zip(rows, states, strict=True):
            passed = b0 * value + state[0]
            state[0], state[1] = b1 * value - a1 * passed + state[1], b2 * value - a2 * passed
            value = passed
        return value

    return step


def moved_db(figures: dict[str, float], channel: dict[str, list[list[float]]], hertz: float, rest: float) -> float:
    """Return how much further than asked a tone moves the drawn display."""
    step_v, count = 2.0 * RANGE_V / 2.0 ** figures["bits"], round(RATE_HZ * max(0.8, 10.0 / hertz))
    matrix = np.array([[0.0, 1.0, 0.0], [-figures["spring"], -figures["drag"], figures["gain"]], [0.0, 0.0, 0.0]])
    held = linalg.expm(matrix / RATE_HZ)
    (xx, xv, xu), (vx, vv, vu) = held[0].tolist(), held[1].tolist()
    time = np.arange(count) / RATE_HZ
    tone = 10.0 ** (LEVEL_DB_SL / 20.0) * np.sin(2.0 * np.pi * hertz * time) * np.minimum(1.0, time / 0.1)
    heard = figures["noise"] * np.random.default_rng(7).standard_normal(count) + rest * step_v
    heard += HUM_V * np.sin(2.0 * np.pi * HUM_HZ * time)
    before, loop = cascade(channel["prefilter_sos"]), channel["feedback_sos"]
    after = None if loop is None else cascade(loop)
    x = v = waiting = 0.0
    moved = np.empty(count)
    for place, (asked, sensed) in enumerate(zip(tone.tolist(), heard.tolist(), strict=True)):
        moved[place] = x
        command = before(asked)
        if after is not None:
            command = after(command - step_v * round((x + sensed) / step_v))
        command = step_v * round(min(max(command, -RANGE_V), RANGE_V - step_v) / step_v)
        x, v = xx * x + xv * v + xu * waiting, vx * x + vv * v + vu * waiting
        waiting = command
    kept = slice(count // 2, None)
    phase = 2.0 * np.pi * hertz * time[kept]
    parts = np.linalg.lstsq(np.column_stack([np.cos(phase), np.sin(phase), np.ones(phase.size)]), moved[kept])[0]
    felt_um = 1e3 * np.hypot(*parts[:2]) / figures["sensor"]
    asked_db = LEVEL_DB_SL + np.interp(np.log(hertz), np.log(CURVE[0]), CURVE[1])
    return float(20.0 * np.log10(max(felt_um, 1e-9)) - asked_db)


def drawn(seed: int) -> tuple[str, dict[str, float]]:
    """Return a display file, and its figures."""
    rng = np.random.default_rng(seed)
    natural = 2.0 * np.pi * np.exp(rng.uniform(np.log(15.0), np.log(60.0)))
    figures = {
        "bits": int(rng.integers(9, 16)),
        "spring": natural**2,
        "drag": 2.0 * rng.uniform(0.2, 0.7) * natural,
        "gain": natural**2 * np.exp(rng.uniform(-1.0, 0.5)),
        "sensor": np.exp(rng.uniform(np.log(1.0), np.log(10.0))),
        "noise": np.exp(rng.uniform(np.log(5e-5), np.log(5e-4))),
    }
    figures["travel"] = min(4.0, 9.0 / figures["sensor"])
    structure = ("none", "integrator-lead-lag", "integrator-lead-lag")[int(rng.integers(3))]
    fixed = {"rate": RATE_HZ, "range_v": RANGE_V, "hertz": CURVE[0], "level": CURVE[1]}
    hum = {"hum_hz": HUM_HZ, "hum_v": HUM_V}
    return TABLE.format(structure=structure, **fixed, **hum, **figures), figures


def main(words: list[str] | None = None) -> int:
    """Draw, check, run and compare; 1 where what was called kept is not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--without", action="store_true", help="as if the verdict had not that finding")
    given = parser.parse_args(words)
    wrong = needless = told = 0
    for seed in range(given.seed, given.seed + given.count):
        text, figures = drawn(seed)
        try:
            designed = tt.design(parse_display(tomllib.loads(text)))
        except (BadInput, NoDesign) as error:
            sys.stdout.write(f"{seed}: no design: {str(error)[:90]}\n")
            continue
        findings = designed.verdict.objectives[0].findings
        lowest = [each for each in findings if each.quantity.endswith("lowest level") and not given.without]
        flat = max(each.value or 0.0 for each in findings if each.quantity == "felt minus asked")
        channel = designed.document()["channels"][0]
        rests = RESTS if channel["feedback_sos"] else RESTS[:1]
        moved = [moved_db(figures, channel, hertz, rest) for hertz in TONES_HZ for rest in rests]
        worst, said = float(np.max(np.abs(moved))), max((each.value or 0.0 for each in lowest), default=flat)
        verdict = "ok"
        if said <= ASKED_DB and worst > ASKED_DB + SLACK_DB:
            wrong, verdict = wrong + 1, "WRONG"
        elif said > ASKED_DB and worst < 0.5 * ASKED_DB:
            needless, verdict = needless + 1, "needless"
        told += said > ASKED_DB
        way = "loop" if channel["feedback_sos"] else "none"
        sys.stdout.write(f"{seed}: {way}, {figures['bits']} bits: said {said:.2f}, moved {worst:.2f} dB: {verdict}\n")
        sys.stdout.flush()
    sys.stdout.write(f"wrong: {wrong}, needless: {needless}, not met: {told}, of {given.count}\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

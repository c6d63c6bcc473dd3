"""Are the 39 phonemes of TAPS felt equally strongly on 24 tactors that differ?

Tactors are drawn: resonances of 60 to 300 Hz, sensitivities of +/- 6 dB. `tactuator design` and `experiment phonemes`
run as commands on a display file of the drawn tactors. What each tactor does with a reference is computed here: the
prefilter from the controller file by SciPy, the tactor's own equation of motion in steps of a sixteenth of a sample,
the level by this file's threshold curve. Seen to fail with --one-gain: the codes go to the tactors by one digital gain,
as without calibration.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import scipy.signal
import soundfile

TACTORS, RATE_HZ, LEVEL_DB, FINE = 24, 8000.0, 30.0, 16
MOST_SPREAD_DB = 1.0
CURVE = ((10.0, 24.0), (30.0, 10.0), (60.0, -0.35), (120.0, -8.0), (200.0, -12.5), (300.0, -12.0), (400.0, -9.0))
"""Threshold at frequencies in Hz, dB re 1 micrometre peak: the display's curve, straight over log frequency."""


def draw(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return natural frequencies in Hz, damping ratios and gains (volts of sensor for a volt) of the tactors."""
    natural = rng.uniform(60.0, 300.0, TACTORS)
    damping = rng.uniform(0.15, 0.5, TACTORS)
    return natural, damping, 10.0 ** (rng.uniform(-6.0, 6.0, TACTORS) / 20.0)


def display(folder: Path, natural: np.ndarray, damping: np.ndarray, gain: np.ndarray) -> Path:
    rows = "".join(f"{hertz:g},{level:g}\n" for hertz, level in CURVE)
    (folder / "curve.csv").write_text(f"frequency_hz,level_db_re_1um\n{rows}")
    head = (
        f'[display]\nname = "sleeve"\nrate_hz = {RATE_HZ:g}\ndelay_samples = 1\n'
        "[converter]\nbits = 16\nrange_v = 10.0\n"
        '[threshold]\ncurve = "curve.csv"\nband_hz = [20.0, 350.0]\n[feedback]\nstructure = "none"\n'
        "[sound]\noutput_full_scale_v = 10.0\n[prefilter]\npoles = 8\n"
        "[environment]\nhum_hz = [50.0]\nhum_v_peak = [0.0]\nnoise_v_rms = 1e-5\n"
        "friction_v = 0.0\npresliding_v = 0.01\n"
    )
    for n in range(TACTORS):
        w, ratio, share = 2.0 * np.pi * float(natural[n]), float(damping[n]), float(gain[n])
        head += (
            f'[[channel]]\nname = "t{n + 1}"\nfinger = "t{n + 1}"\nsensor_gain_v_per_mm = 5.0\ntravel_mm = 2.0\n'
            f"plant = {{ num = [{share * w * w!r}], den = [1.0, {2.0 * ratio * w!r}, {w * w!r}] }}\n"
        )
    path = folder / "display.toml"
    path.write_text(head)
    return path


def moved_um(volts: np.ndarray, natural: float, damping: float, gain: float) -> np.ndarray:
    """Return the micrometres at each fine step, for volts held between samples: x'' = w^2 (g u - x) - 2 z w x'."""
    w, step = 2.0 * np.pi * natural, 1.0 / (RATE_HZ * FINE)
    force = gain * w * w * np.repeat(volts, FINE)
    x = v = 0.0
    out = np.empty(force.size)
    for n, f in enumerate(force):
        v += step * (f - w * w * x - 2.0 * damping * w * v)
        x += step * v
        out[n] = x
    return 1e3 * out / 5.0


def level_db(asked: np.ndarray, felt_um: list[np.ndarray]) -> float:
    """Return the felt level of a code: LEVEL_DB where the energy over threshold is what was asked for."""
    energy = 0.0
    for um in felt_um:
        spectrum, hertz = np.abs(np.fft.rfft(um)) ** 2, np.fft.rfftfreq(um.size, 1.0 / (RATE_HZ * FINE))
        threshold = np.interp(np.log(np.maximum(hertz, 1e-3)), np.log([at for at, _ in CURVE]), [db for _, db in CURVE])
        energy += 2.0 * float(np.sum(spectrum / 10.0 ** (threshold / 10.0))) / um.size / FINE
    return float(LEVEL_DB + 10.0 * np.log10(energy / np.sum(asked**2)))


def run(*arguments: str) -> dict[str, object]:
    done = subprocess.run([sys.executable, "-m", "tactuator", *arguments, "--json"], capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(done.stdout + done.stderr)
    return dict(json.loads(done.stdout))


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--one-gain", action="store_true")
    asked = options.parse_args()
    natural, damping, gain = draw(np.random.default_rng(asked.seed))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path, controller = display(folder, natural, damping, gain), folder / "c.json"
        run("design", str(path), "--out", str(controller))
        code = ("--controller", str(controller), "--out", str(folder / "set"), "--level", str(LEVEL_DB))
        run("experiment", "phonemes", *code)
        document = json.loads(controller.read_text())
        prefilters = [np.array(channel["prefilter_sos"]) for channel in document["channels"]]
        levels = {}
        for file in sorted((folder / "set").glob("*.wav")):
            samples, _ = soundfile.read(file, always_2d=True)
            head = json.loads(file.with_suffix(".json").read_text())
            reference = samples * 10.0 ** (head["full_scale_db_sl"] / 20.0)
            felt = []
            for column in np.flatnonzero(np.any(reference, axis=0)):
                wave = np.concatenate([reference[:, column], np.zeros(800)])
                volts = 1e-3 * wave if asked.one_gain else scipy.signal.sosfilt(prefilters[column], wave)
                felt.append(moved_um(volts, natural[column], damping[column], gain[column]))
            levels[file.stem] = level_db(reference, felt)
    spread = max(levels.values()) - min(levels.values())
    for phoneme, level in sorted(levels.items(), key=lambda item: item[1]):
        print(f"{phoneme:3s} {level:6.2f} dB SL")
    mean = float(np.mean(list(levels.values()))) - LEVEL_DB
    print(f"spread {spread:.2f} dB over {len(levels)} phonemes; mean less asked {mean:.2f} dB")
    print("MET" if spread <= MOST_SPREAD_DB else "BROKEN")
    raise SystemExit(spread > MOST_SPREAD_DB)


if __name__ == "__main__":
    main()

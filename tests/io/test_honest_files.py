"""Twelve files as laboratories have them, without options where a person would need none: identified, and right.

Two mechanisms are stepped by SciPy: 35 Hz, and 1.2 Hz upside down under a stabilising loop. Nothing of the project
makes a file or a truth.
"""

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from tactuator.cli import main

Array = NDArray[Any]
RATE_HZ, SECONDS = 2000.0, 5.0
TIME = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
W = 2.0 * np.pi * 35.0
NUM, DEN = [0.8 * W**2], [1.0, 0.5 * W, W**2]
UNSTABLE = [300.0], [1.0, 0.0, -((2.0 * np.pi * 1.2) ** 2)]
HERTZ = np.geomspace(4.0, 400.0, 90)
S = 2j * np.pi * HERTZ
PLANT = np.polyval(NUM, S) / np.polyval(DEN, S)
H = PLANT * (1.0 + 0.002 * np.random.default_rng(8).standard_normal(HERTZ.size))
DB, DEG = 20.0 * np.log10(np.abs(H)), np.degrees(np.angle(H))


def driven(seed: int, order: int = 0, scale: float = 1.0) -> tuple[Array, Array]:
    """Return a random command of steps and noise, and the position, velocity or acceleration by order, times scale."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(-1.0, 1.0, TIME.size // 50), 50) + 0.3 * rng.standard_normal(TIME.size)
    b, a, _ = signal.cont2discrete((NUM + [0.0] * order, DEN), 1.0 / RATE_HZ)
    moved = scale * signal.lfilter(np.ravel(b), a, command)
    return command, moved + 1e-3 * np.std(moved) * rng.standard_normal(TIME.size)


def looped(plant: Any, gains: tuple[float, float, float], dither: float, seed: int) -> tuple[Array, Array, Array]:
    """Return reference, command and position under proportional, integral and derivative action: held levels."""
    rng = np.random.default_rng(seed)
    b, a, _ = signal.cont2discrete(plant, 1.0 / RATE_HZ)
    b = np.ravel(b)
    reference = np.repeat(rng.uniform(-1.0, 1.0, TIME.size // 100), 100)
    shaken = dither * np.repeat(np.sign(rng.standard_normal(TIME.size // 4)), 4)
    command, position, x, integral, before = np.zeros(TIME.size), np.zeros(TIME.size), np.zeros(2), 0.0, 0.0
    for k in range(TIME.size):
        position[k] = x[0] + 1e-3 * rng.standard_normal()
        error = reference[k] - position[k]
        integral += error / RATE_HZ
        command[k] = gains[0] * error + gains[1] * integral - gains[2] * (position[k] - before) * RATE_HZ + shaken[k]
        before = position[k]
        x = np.array([b[1] * command[k] - a[1] * x[0] + x[1], b[2] * command[k] - a[2] * x[0]])
    return reference, command, position


def rows(*columns: Array, mark: str = ",", end: str = "\n") -> str:
    return "".join(mark.join(f"{value:.9g}" for value in row) + end for row in zip(*columns, strict=True))


def files() -> Iterator[tuple[str, str, str, list[str], Array | None, float]]:
    """Yield name, ending, text, options, the truth at HERTZ (of the 35 Hz mechanism; None: see the loop) and dB."""
    u, y = driven(1)
    head = "LabVIEW Measurement\t\nDecimal_Separator\t,\nX_Columns\tNo\n***End_of_Header***\t\n\t\nChannels\t2\t\n"
    head += "Samples\t10000\t10000\nX0\t0,0\t0,0\nDelta_X\t0,0005\t0,0005\n***End_of_Header***\t\n"
    body = "".join(f"\t{a:.9g}\t{b:.9g}\n" for a, b in zip(u, y, strict=True)).replace(".", ",")
    yield "lvm", ".lvm", head + "X_Value\tDrive\tSensor\tComment\n" + body, [], PLANT, 0.1
    u, y = driven(2, 1, 0.02)
    head = "#Digilent WaveForms Oscilloscope Acquisition\n#Sample rate: 2000Hz\n#Samples: 10000\n\n"
    head += "Time (s),Command (V),Velocity (mm/s)\n"
    yield "waveforms, velocity", ".csv", head + rows(TIME - 0.5, u, y), [], 0.02 * S * PLANT, 0.1
    u, y = driven(3)
    head = "Record Length,Analog:10k,\nSample Interval,Analog:5.0E-04,\nVertical Units,CH1:V,CH2:V\n"
    yield "siglent", ".csv", head + "Source,CH1,CH2\nSecond,Volt,Volt\n" + rows(TIME, u, y), [], PLANT, 0.1
    u, y = driven(4, 2, 1e-5)
    other = driven(5, 2, 1e-5)
    log = "t [s];I_thumb [A];acc_thumb [g];I_index [A];acc_index [g];temperature [C]\n"
    log += rows(TIME, *other, u, y, 20.0 + 0.01 * TIME, mark=";").replace(".", ",")
    named = ["--input", "I_index [A]", "--output", "acc_index [g]"]
    yield "channels, amperes", ".txt", log, named, 1e-5 * S**2 * PLANT, 0.1
    u, y = driven(6)
    wrapped = (np.round(TIME * 1e6) + 2**32 - 2e6) % 2**32
    yield "wrapped microseconds", ".csv", "micros_us,u,y\n" + rows(wrapped, u, y), [], PLANT, 0.1
    reference, u, y = looped((NUM, DEN), (0.8, 60.0, 0.0), 0.1, 7)
    yield "held references", ".csv", "t,u,y\n" + rows(TIME, u, y), [], PLANT, 0.5
    reference, u, y = looped(UNSTABLE, (2.5, 0.0, 0.12), 0.2, 8)
    yield "stabilised", ".csv", "t,reference,u,y\n" + rows(TIME, reference, u, y), [], None, 0.5
    up = [np.r_[each, each[::-1]] for each in (HERTZ, DB, DEG)]
    yield (
        "frd, up and down",
        ".frd",
        "* sweep 4-400-4\n* Freq(Hz) Mag(dB) Phase(deg)\n" + rows(*up, mark=" "),
        [],
        PLANT,
        0.1,
    )
    yield "zma", ".zma", "* impedance, box 3\n" + rows(HERTZ, np.abs(H), DEG, mark="\t"), [], PLANT, 0.1
    yield "touchstone", ".s1p", "! VNA\n# kHz S RI R 50\n" + rows(HERTZ / 1e3, H.real, H.imag, mark=" "), [], PLANT, 0.1
    head = "Bode\nDevice: E5061B\n\nFrequency,Trace 1 Gain,Trace 1 Phase\n(Hz),(dB),(\u00b0)\n"
    yield "bode, row of units", ".csv", head + rows(HERTZ, DB, DEG), [], PLANT, 0.1
    turned = np.unwrap(np.angle(H))
    radians = "omega (rad/s),|H| (mm/V),arg (rad),coherence\n" + rows(
        2.0 * np.pi * HERTZ, np.abs(H), turned, 0.9999 + 0.0 * HERTZ
    )
    yield "radians", ".dat", radians, [], PLANT, 0.1


NAMES = (
    "lvm", "waveforms, velocity", "siglent", "channels, amperes", "wrapped microseconds", "held references",
    "stabilised", "frd, up and down", "zma", "touchstone", "bode, row of units", "radians",
)  # fmt: skip
MADE = cache(lambda: {name: given for name, *given in files()})  # when asked for: workers import what they do not run


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_identify__an_honest_file__is_right_and_trusted(tmp_path: Path, capsys: Any, name: str) -> None:
    ending, text, options, truth, most_db = MADE()[name]
    path, out = tmp_path / f"table{ending}", tmp_path / "model.json"
    path.write_text(text, encoding="utf-8")
    assert main(["identify", str(path), *options, "--out", str(out)]) == 0, capsys.readouterr().err
    model = json.loads(out.read_text())
    if truth is None:
        truth = np.polyval(UNSTABLE[0], S) / np.polyval(UNSTABLE[1], S)
    found = np.polyval(model["num"], S) / np.polyval(model["den"], S) * np.exp(-model.get("delay_s", 0.0) * S)
    low, high = model["valid_hz"]
    valid = (low <= HERTZ) & (high >= HERTZ)
    assert np.sum(valid) > HERTZ.size // 3
    off_db = float(np.max(np.abs(20.0 * np.log10(np.abs(found / truth)))[valid]))
    assert off_db < most_db

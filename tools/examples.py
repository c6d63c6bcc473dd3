"""Write the generated files of the examples that `tactuator init --examples` copies out, each from a seed.

`python -m tools.examples [FOLDER]`. Displays, protocols and README of the folder are written by hand and stay. The
record comes from the simulated display, with its friction, hum, noise and converters; the speech is synthesised.
"""

import sys
from pathlib import Path

import numpy as np
import soundfile
from scipy import signal

from tactuator.api.parameters import paper_display
from tactuator.io.display import parse_display
from tactuator.io.shipped import EXAMPLES
from tactuator.perception.curve import curve
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.excitation import paper_mix
from tactuator.speech.coding import coding_of, write_coding
from tactuator.speech.render import RenderJob, render_file
from tactuator.synthesis.design import design_controller
from tools.formant_synthesis import RATE_HZ, Sound, synthesise

SEED = 1
BENCH_RATE_HZ, BENCH_S = 2000.0, 8.0
BENCH = {
    "display": {"name": "bench", "rate_hz": BENCH_RATE_HZ},
    "channel": [
        {
            "name": "index",
            "sensor_gain_v_per_mm": 0.199,
            "travel_mm": 12.5,
            "plant": {"num": [2740.0], "den": [1.0, 97.0, 305.0]},
            "friction_v": 8.0e-3,
        }
    ],
}
"""The mechanism of the bench record: near the paper's, and not equal to it."""
VOWELS = {"a": (730.0, 1090.0, 2440.0), "i": (270.0, 2290.0, 3010.0), "u": (300.0, 870.0, 2240.0)}
"""Formants (Hz) of an adult male's vowels in Peterson & Barney (1952), rounded."""
PAUSE = Sound(0.15, (500.0, 1500.0, 2500.0), 110.0, 0.0)


def write_all(folder):
    """Write every generated file into the folder of examples."""
    rng = np.random.default_rng(SEED)
    write_bench(folder / "bench.csv")
    write_pairs(folder / "pairs.csv", rng)
    write_response(folder / "sheet.csv", rng)
    write_curves(folder, rng)
    write_matrix(folder / "confusion.csv", rng)
    write_coding(folder / "coding.toml", coding_of("envelope"))
    write_speech(folder)
    write_items(folder / "protocols")


def write_bench(path):
    """Write a record of eight seconds as a laboratory's own program would: columns t, drive, encoder."""
    display = parse_display(BENCH)
    rng = np.random.default_rng(SEED)
    one = display.channels[0]
    travel_v = 0.5 * one.travel_mm * one.sensor_gain_v_per_mm
    band = (0.4, 300.0)
    command = paper_mix(BENCH_S, BENCH_RATE_HZ, 10.0, rng, plant=one.plant, travel_v=travel_v, band_hz=band)
    trace = SimulatedRig(display, seed=SEED).drive(command[:, np.newaxis])
    rows = zip(trace.command_v[:, 0], trace.position_v[:, 0], strict=True)
    lines = [f"{k / BENCH_RATE_HZ:.4f},{u:.5f},{y:.6f}" for k, (u, y) in enumerate(rows)]
    path.write_text("\n".join(["t,drive,encoder", *lines]) + "\n", encoding="ascii")


def write_pairs(path, rng):
    """Write thirteen readings of a dial gauge and the sensor; in one of them the gauge was read a turn too low."""
    displacement = np.linspace(-9.0, 9.0, 13)
    voltage = 0.199 * displacement + 0.031 + 0.5e-3 * rng.standard_normal(13)
    read = np.round(displacement + 0.01 * rng.standard_normal(13), 2)
    read[9] -= 1.0
    lines = [f"p{k + 1:02d},{x:.2f},{v:.4f}" for k, (x, v) in enumerate(zip(read, voltage, strict=True))]
    path.write_text("\n".join(["name,displacement_mm,voltage_v", *lines]) + "\n", encoding="ascii")


def write_response(path, rng):
    """Write the response of a linear resonant actuator as a data sheet has it: frequency, magnitude, phase."""
    frequency = np.geomspace(20.0, 400.0, 60)
    _, response = signal.freqs([60445.0], [1.0, 73.3, 1208902.0], 2.0 * np.pi * frequency)
    level = 20.0 * np.log10(np.abs(response)) + 0.05 * rng.standard_normal(60)
    phase = np.degrees(np.angle(response)) + 0.5 * rng.standard_normal(60)
    lines = [f"{f:.2f},{m:.2f},{p:.1f}" for f, m, p in zip(frequency, level, phase, strict=True)]
    path.write_text("\n".join(["frequency_hz,magnitude_db,phase_deg", *lines]) + "\n", encoding="ascii")


def write_curves(folder, rng):
    """Write one person's threshold curve, and a hearing-impaired person's loss for the simulated observers."""
    usual = curve("bolanowski-1988")
    frequency = np.array([0.4, 1.0, 2.0, 5.0, 10.0, 25.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0])
    level = (
        usual.level_db_re_1um_at(frequency)
        + 2.0
        + 1.5 * np.log10(frequency / 10.0)
        + rng.standard_normal(frequency.size)
    )
    head = [
        "# name: S1",
        "# provenance: synthetic",
        "# source: tools/examples.py; the library's curve, moved by 2 dB with a scatter of 1 dB",
        "frequency_hz,level_db_re_1um,standard_error_db",
    ]
    lines = [f"{f:g},{one:.1f},1.0" for f, one in zip(frequency, level, strict=True)]
    (folder / "curve.csv").write_text("\n".join([*head, *lines]) + "\n", encoding="ascii")
    loss = ["frequency_hz,level_db_sl", "0.4,0", "10,0", "40,6", "100,18", "250,30"]
    (folder / "loss.csv").write_text("\n".join(loss) + "\n", encoding="ascii")


def write_matrix(path, rng):
    """Write a confusion matrix: 40 answers to each of five items, three in four of them right."""
    names = ("pa", "ta", "ka", "ba", "da")
    shares = 0.05 + np.eye(5) * 0.75
    counts = [rng.multinomial(40, row / row.sum()) for row in shares]
    lines = [",".join([name, *map(str, row)]) for name, row in zip(names, counts, strict=True)]
    path.write_text("\n".join([",".join(["", *names]), *lines]) + "\n", encoding="ascii")


def vowel(name, duration_s, pitch_hz):
    """Return one vowel as a sound to be synthesised."""
    return Sound(duration_s, VOWELS[name], pitch_hz)


def write_speech(folder):
    """Write a phrase, and a folder with two short recordings in two formats."""
    m, s = Sound(0.09, (250.0, 1100.0, 2300.0), 118.0, 0.45), Sound(0.13, (1500.0, 3800.0, 5200.0), 140.0, 0.0, 0.7)
    phrase = (m, vowel("a", 0.2, 132.0), m, vowel("i", 0.22, 124.0), PAUSE, s, vowel("u", 0.2, 138.0), m,
              vowel("a", 0.25, 112.0), PAUSE, s, vowel("i", 0.2, 120.0), s, vowel("a", 0.3, 98.0))  # fmt: skip
    soundfile.write(folder / "speech.wav", synthesise(phrase, SEED), RATE_HZ, subtype="PCM_16")
    recordings = folder / "recordings"
    recordings.mkdir(exist_ok=True)
    for name, sounds in {"one.wav": (m, *phrase[1:4]), "two.flac": (s, *phrase[6:9])}.items():
        soundfile.write(recordings / name, synthesise((PAUSE, *sounds, PAUSE), SEED), RATE_HZ, subtype="PCM_16")


def write_items(folder):
    """Write the vowels that the recognition protocols ask for, as references in dB SL for display.toml."""
    job = RenderJob(design_controller(paper_display()), coding_of("bands"))
    spoken = folder / "vowel.wav"
    try:
        for name in VOWELS:
            soundfile.write(spoken, synthesise((vowel(name, 0.5, 120.0),), SEED), RATE_HZ, subtype="PCM_16")
            render_file(spoken, folder / f"{name}.wav", job)
    finally:
        spoken.unlink(missing_ok=True)


if __name__ == "__main__":
    write_all(Path(sys.argv[1]) if len(sys.argv) > 1 else EXAMPLES)

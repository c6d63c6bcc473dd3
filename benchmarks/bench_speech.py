"""Speech against real time, on one core: rendering by coding, and with three fingers felt, each beside a peer.

The peers are what one would type at a prompt, with the whole file in memory: no level in dB SL, no limiter, no file.
Direct: `scipy.signal.resample_poly`, one FIR through `scipy.signal.oaconvolve`, scaled. Envelope: `sosfilt` of
`scipy.signal` once for each filter of the same bands and of the voicing. Felt: the bare simulation of the three loops
on a reference that is there already.
"""

import resource
import sys
import tempfile
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import soundfile
from scipy import signal
from timing import in_turn

from tactuator.io.display import parse_display
from tactuator.model.controller import Controller
from tactuator.rig.simulated import SimulatedRig
from tactuator.speech.coding import coding_of
from tactuator.speech.envelope_coding import EnvelopeCoding
from tactuator.speech.reading import sample_path
from tactuator.speech.render import RenderJob, render_file
from tactuator.synthesis.design import design_controller

MINUTES = 10.0
DISPLAY = """
[display]
name = "three fingers"
rate_hz = 4000
delay_samples = 1
[threshold]
curve = "bolanowski-1988"
[feedback]
structure = "paper"
""" + "".join(
    f"""
[[channel]]
name = "{name}"
finger = "{name}"
sensor_gain_v_per_mm = {gain}
travel_mm = 12.5
plant = {{ num = [{num}], den = {den} }}
loads = [{{ name = "finger", mass = 0.12, damping = 31.0, stiffness = 360.0 }}]
"""
    for name, gain, num, den in (
        ("index", 0.19898, 2875.0, [1.0, 94.0, 290.0]),
        ("thumb", 0.2012, 2650.0, [1.0, 101.0, 310.0]),
        ("middle", 0.1967, 3020.0, [1.0, 88.0, 275.0]),
    )
)


def run() -> dict[str, object]:
    """Return seconds of speech for each second of one core, and each work's time over its peer's."""
    controller = design_controller(parse_display(tomllib.loads(DISPLAY)))
    with tempfile.TemporaryDirectory() as folder:
        speech = long_speech(Path(folder) / "speech.wav", MINUTES)
        seconds = soundfile.info(speech).duration
        works: dict[str, Callable[[], None]] = {
            name: partial(render, speech, folder, RenderJob(controller, coding_of(name)))
            for name in ("direct", "bands", "envelope")
        }
        works["direct_felt"] = partial(
            render, speech, folder, RenderJob(controller, coding_of("direct"), simulate=True)
        )
        works["peer"] = partial(peer, speech)
        works["sosfilt"] = partial(sosfilt_bands, speech)
        works["bare_loops"] = partial(bare_loops, controller, seconds)
        spent = in_turn(works)
    return {
        "minutes": MINUTES,
        **{f"{name}_times_real_time": seconds / each for name, each in spent.items()},
        "direct_over_peer": spent["direct"] / spent["peer"],
        "envelope_over_sosfilt": spent["envelope"] / spent["sosfilt"],
        "direct_felt_over_bare_loops": spent["direct_felt"] / spent["bare_loops"],
        "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def long_speech(path: Path, minutes: float) -> Path:
    """The shipped sample over and over, each time a little louder or softer, 16 kHz, 16 bit."""
    sample, rate = soundfile.read(sample_path())
    rng = np.random.default_rng(0)
    with soundfile.SoundFile(path, "w", rate, 1, "PCM_16") as file:
        for _ in range(round(minutes * 60.0 * rate / len(sample))):
            file.write(sample * rng.uniform(0.5, 1.0))
    return path


def render(speech: Path, folder: str, job: RenderJob) -> None:
    render_file(speech, Path(tempfile.mkdtemp(dir=folder)) / "reference.wav", job)  # to remove what is there takes time


def peer(speech: Path) -> None:
    samples, rate = soundfile.read(speech)
    slow = signal.resample_poly(samples, 1, 4)
    kernel = signal.firwin(1001, [2.0, 290.0], pass_zero=False, fs=rate / 4)
    filtered = signal.oaconvolve(slow, kernel, "same")
    np.repeat((filtered / filtered.std())[:, None], 3, axis=1)


def sosfilt_bands(speech: Path) -> None:
    """Filter, rectify, take to 4 kHz and smooth every band of the default envelope coding and of its voicing."""
    samples, rate = soundfile.read(speech)
    voicing = EnvelopeCoding().voicing
    bands = [(one.order, one.low_hz, one.high_hz, one.smooth_order, one.smooth_hz) for one in EnvelopeCoding().bands]
    bands += [(2, 60.0, voicing.low_hz, 2, voicing.smooth_hz), (2, voicing.high_hz, 0.45 * rate, 2, voicing.smooth_hz)]
    for order, low_hz, high_hz, smooth_order, smooth_hz in bands:
        band = signal.butter(order, [low_hz, high_hz], "bandpass", fs=rate, output="sos")
        smooth = signal.butter(smooth_order, smooth_hz, fs=rate / 4, output="sos")
        rectified = np.abs(signal.sosfilt(band, samples))
        signal.sosfilt(smooth, rectified[: rectified.size // 4 * 4].reshape(-1, 4).mean(axis=1))


def bare_loops(controller: Controller, seconds: float) -> None:
    """Play noise of 20 dB SL on the simulated display in blocks of 4 s, and drop what comes."""
    rig = SimulatedRig(controller.display, 0)
    rig.load(controller)
    block = np.random.default_rng(0).normal(0.0, 10.0, (16_000, len(controller.channels)))
    for _ in range(round(seconds / 4.0)):
        rig.play(block)


if __name__ == "__main__":
    MINUTES = float(sys.argv[1]) if len(sys.argv) > 1 else MINUTES
    print(run())

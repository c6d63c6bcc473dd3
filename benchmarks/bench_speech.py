"""Speech against real time, on one core: rendering by coding, and with three fingers felt.

The peer is what one would type at a prompt: the whole file in memory, `scipy.signal.resample_poly`, one FIR through
`scipy.signal.oaconvolve`, scaled; no level in dB SL, no limiter, no file.
"""

import resource
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import soundfile
from scipy import signal

from tactuator.files.display import parse_display
from tactuator.speech.coding.file import NAMED
from tactuator.speech.job import RenderJob, render_file
from tactuator.speech.synthesis import sample_path
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
    """Seconds of speech for each second of one core."""
    controller = design_controller(parse_display(tomllib.loads(DISPLAY)))
    with tempfile.TemporaryDirectory() as folder:
        speech = long_speech(Path(folder) / "speech.wav", MINUTES)
        seconds = soundfile.info(speech).duration
        figures: dict[str, object] = {"minutes": MINUTES}
        for name in ("direct", "bands", "envelope"):
            job = RenderJob(controller, NAMED[name])
            figures[f"{name}_times_real_time"] = seconds / busy_s(render, speech, folder, job)
        felt = RenderJob(controller, NAMED["direct"], simulate=True)
        figures["direct_felt_times_real_time"] = seconds / busy_s(render, speech, folder, felt)
        figures["peer_times_real_time"] = seconds / busy_s(peer, speech)
        figures["peak_memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return figures


def long_speech(path: Path, minutes: float) -> Path:
    """The shipped sample over and over, each time a little louder or softer, 16 kHz, 16 bit."""
    sample, rate = soundfile.read(sample_path())
    rng = np.random.default_rng(0)
    with soundfile.SoundFile(path, "w", rate, 1, "PCM_16") as file:
        for _ in range(round(minutes * 60.0 * rate / len(sample))):
            file.write(sample * rng.uniform(0.5, 1.0))
    return path


def busy_s(work: Callable[..., None], *arguments: object) -> float:
    """The least of three processor times."""
    times = []
    for _ in range(3):
        begun = time.process_time()
        work(*arguments)
        times.append(time.process_time() - begun)
    return min(times)


def render(speech: Path, folder: str, job: RenderJob) -> None:
    render_file(speech, Path(folder) / "reference.wav", job)


def peer(speech: Path) -> None:
    samples, rate = soundfile.read(speech)
    slow = signal.resample_poly(samples, 1, 4)
    kernel = signal.firwin(1001, [2.0, 290.0], pass_zero=False, fs=rate / 4)
    filtered = signal.oaconvolve(slow, kernel, "same")
    np.repeat((filtered / filtered.std())[:, None], 3, axis=1)


if __name__ == "__main__":
    MINUTES = float(sys.argv[1]) if len(sys.argv) > 1 else MINUTES
    print(run())

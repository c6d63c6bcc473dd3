"""One speech file to one reference file, and what is felt of it: the same job for a single file and for a corpus."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactuator import __version__
from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceHead, ReferenceWriter, check_suffix, write_reference
from tactuator.measure.felt import FeltComparison, FeltReport
from tactuator.measure.listening import SETTLE_S, felt_of
from tactuator.model.controller import Controller
from tactuator.rig.simulated import SimulatedRig
from tactuator.speech.coding.coding import Coding
from tactuator.speech.coding.file import coding_document
from tactuator.speech.limiter.limiter import FingerLimiting
from tactuator.speech.reading import SpeechFile
from tactuator.speech.render import LEVEL_DB_SL, Rendering, rendering

Progress = Callable[[float], None]


@dataclass(frozen=True)
class RenderJob:
    """Task that is done for every file. seed: of the simulated display; simulate: whether it is to be felt at all."""

    controller: Controller
    coding: Coding
    level_db_sl: float = LEVEL_DB_SL
    simulate: bool = False
    seed: int = 0

    def parameters(self) -> dict[str, Any]:
        """Return everything that the result depends on but the speech, in plain JSON."""
        return {
            "tool": __version__,
            "controller": self.controller.content_hash,
            "coding": coding_document(self.coding),
            "level_db_sl": self.level_db_sl,
            "felt": {"seed": self.seed} if self.simulate else None,
        }


@dataclass(frozen=True, eq=False)
class Rendered:
    """Result of one file. sha256: of the reference's samples as a WAV holds them."""

    speech: SpeechFile
    frames: int
    rate_hz: float
    channels: tuple[str, ...]
    gain: float
    peak_db_sl: dict[str, float]
    limiting: tuple[FingerLimiting, ...]
    sha256: str
    felt: FeltReport | None

    def document(self) -> dict[str, Any]:
        """Return the figures in plain JSON."""
        return {
            "speech": str(self.speech.path),
            "notes": list(self.speech.notes),
            "encoding": self.speech.encoding,
            "duration_s": self.speech.duration_s,
            "rate_hz": self.rate_hz,
            "frames": self.frames,
            "channels": list(self.channels),
            "threshold_units_per_full_scale": self.gain,
            "peak_db_sl": self.peak_db_sl,
            "limiter": {
                entry.finger: {k: v for k, v in asdict(entry).items() if k != "finger"} for entry in self.limiting
            },
            "sha256": self.sha256,
            "felt": None if self.felt is None else self.felt.figures(),
        }


def render_file(
    speech: str | Path,
    out: str | Path,
    job: RenderJob,
    felt_out: str | Path | None = None,
    progress: Progress = lambda done: None,
) -> Rendered:
    """Render `speech` to the reference `out`, and what is felt of it to `felt_out`; files appear whole or not at all.

    felt_out (which asks for the simulation) holds the displacement weighted by the inverse threshold curve, in
    threshold units like the reference itself. Raises BadInput as `rendering` and `write_reference` do.
    """
    out, felt_out = Path(out), None if felt_out is None else Path(felt_out)
    for path in (out, felt_out):
        if path is not None:
            check_suffix(path)
    if felt_out is not None and felt_out.resolve() == out.resolve():
        raise BadInput(f"--felt and --out are both {out}", "two files")
    controller = job.controller
    with ExitStack() as stack:
        making = stack.enter_context(rendering(speech, controller, job.coding, job.level_db_sl, out.parent))
        head = _head(making, job)
        writer = stack.enter_context(write_reference(out, head, making.frames))
        counting = _Counting(making, writer, progress)
        felt = None
        if felt_out is not None or job.simulate:
            sink = None
            if felt_out is not None:
                sink = stack.enter_context(write_reference(felt_out, _felt_head(head), making.frames)).write
            felt = _feel(counting.blocks(), job, sink)
        else:
            for _ in counting.blocks():
                pass
    return Rendered(
        speech=making.speech,
        frames=making.frames,
        rate_hz=controller.rate_hz,
        channels=making.channels,
        gain=making.gain,
        peak_db_sl=counting.peak_db_sl(),
        limiting=making.limiting,
        sha256=writer.sha256,
        felt=felt,
    )


class _Counting:
    """Writes the blocks on their way, and keeps their peaks."""

    def __init__(self, making: Rendering, writer: ReferenceWriter, progress: Progress) -> None:
        self._making, self._writer, self._progress = making, writer, progress
        self._peaks = np.zeros(len(making.channels))

    def blocks(self) -> Iterator[FloatArray]:
        for block in self._making.blocks():
            self._writer.write(block)
            columns = np.ascontiguousarray(block.T)  # a maximum along short rows takes ten times as long
            self._peaks = np.maximum(self._peaks, np.abs(columns).max(axis=1, initial=0.0))
            self._progress(self._writer.frames / max(1, self._making.frames))
            yield block

    def peak_db_sl(self) -> dict[str, float]:
        with np.errstate(divide="ignore"):
            return dict(zip(self._making.channels, (20.0 * np.log10(self._peaks)).tolist(), strict=True))


def _feel(blocks: Iterator[FloatArray], job: RenderJob, sink: Callable[[FloatArray], None] | None) -> FeltReport:
    rig = SimulatedRig(job.controller.display, job.seed)
    rig.load(job.controller)
    comparison = FeltComparison(job.controller, sink)
    silence = np.zeros((round(SETTLE_S * rig.rate_hz), len(rig.channels)))
    for reference, displacement in felt_of(rig, _then(blocks, silence)):
        comparison.push(reference, displacement)
    return comparison.finish()


def _then(blocks: Iterator[FloatArray], last: FloatArray) -> Iterator[FloatArray]:
    yield from blocks
    yield last


def _head(making: Rendering, job: RenderJob) -> ReferenceHead:
    channels = job.controller.display.channels
    curves = {c.name: (c.threshold.curve.name, c.threshold.curve.content_hash) for c in channels}
    band = (min(c.threshold.band_hz[0] for c in channels), max(c.threshold.band_hz[1] for c in channels))
    provenance = {
        "speech": making.speech.path.name,
        "speech_rate_hz": making.speech.rate_hz,
        "speech_frames": making.speech.frames,
        "notes": list(making.speech.notes),
        **job.parameters(),
    }
    return ReferenceHead(job.controller.rate_hz, making.channels, curves, band, provenance=provenance)


def _felt_head(head: ReferenceHead) -> ReferenceHead:
    provenance = {"what": "felt: displacement weighted by the inverse threshold curve", **head.provenance}
    return ReferenceHead(head.rate_hz, head.channels, head.curves, head.band_hz, provenance=provenance)

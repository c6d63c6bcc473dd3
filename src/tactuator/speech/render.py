"""A source to a reference: what it asks of the display, limited, streamed from the first sample to the last; and what
is felt of it.

A source is a speech file, a haptic clip, or an alignment of phonemes; the ending of its name says which.
"""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from tactuator import __version__
from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceHead, check_suffix, curves_of, write_reference
from tactuator.measure.felt import FeltReport, compare_felt
from tactuator.model.controller import Controller
from tactuator.plain import brief, picked
from tactuator.rig.simulated import SimulatedRig
from tactuator.speech.band_codings import DirectCoding
from tactuator.speech.clip_signal import clip_signal, read_clip
from tactuator.speech.coding import Coding, coding_document
from tactuator.speech.limiter import FingerLimiting, Limiter
from tactuator.speech.live.rendering import live_signal
from tactuator.speech.options import LEVEL_DB_SL
from tactuator.speech.signal import Loss, Signal
from tactuator.speech.spoken import speech_signal
from tactuator.speech.taps import taps_signal
from tactuator.speech.textgrid import read_textgrid

Progress = Callable[[float], None]
KINDS: Mapping[str, str] = {".haptic": "clip", ".ahap": "clip", ".textgrid": "alignment"}
"""Kinds of sources by ending; any other is speech."""


def kind_of_source(path: str | Path) -> str:
    """Return the kind of a source by its name: speech, clip or alignment."""
    return KINDS.get(Path(path).suffix.lower(), "speech")


@dataclass(frozen=True)
class RenderJob:
    """What is done to every source.

    level_db_sl: of an utterance, of a clip's strength 1, of a burst. coding: of speech. layout: of an alignment, the
    channel of each tactor (None: the usual one). legacy: of a clip, see `parse_haptic`. live: speech as `live_signal`
    has it. simulate: whether it is to be felt, on a simulated display of that seed.
    """

    controller: Controller
    coding: Coding = field(default_factory=DirectCoding)
    level_db_sl: float = LEVEL_DB_SL
    simulate: bool = False
    seed: int = 0
    layout: tuple[int, ...] | None = None
    legacy: bool = False
    live: bool = False

    def settings(self, kind: str) -> dict[str, Any]:
        """Return what the reference of a source of that kind depends on beside it, in plain JSON."""
        settings: dict[str, Any] = {
            "tool": __version__,
            "controller": self.controller.content_hash,
            "level_db_sl": self.level_db_sl,
        }
        if kind == "speech":
            settings["coding"] = coding_document(self.coding) | ({"live": True} if self.live else {})
        if kind == "alignment":
            settings["layout"] = self.layout and list(self.layout)
        return settings


@dataclass(frozen=True, eq=False)
class Rendered:
    """A reference as it was written, and what became of its source: `about`, `notes` and `loss` are the signal's.

    sha256: of the reference's samples as a WAV holds them.
    """

    frames: int
    rate_hz: float
    channels: tuple[str, ...]
    peak_db_sl: dict[str, float]
    limiting: tuple[FingerLimiting, ...]
    sha256: str
    about: Mapping[str, Any]
    notes: tuple[str, ...]
    loss: Loss | None
    felt: FeltReport | None

    __repr__ = brief

    @property
    def duration_s(self) -> float:
        """Return the length of the source, seconds."""
        return float(self.about.get("duration_s", self.frames / self.rate_hz))

    def figures(self) -> dict[str, Any]:
        """Return how strong the reference is and what was taken back of it; a silent channel has no peak."""
        return {
            "duration_s": self.duration_s,
            "peak_db_sl": {name: peak if isfinite(peak) else None for name, peak in self.peak_db_sl.items()},
            "limiter": {each.finger: {k: v for k, v in vars(each).items() if k != "finger"} for each in self.limiting},
            "loss": self.loss and self.loss.document(),
        }

    def document(self) -> dict[str, Any]:
        """Return all figures, plain JSON."""
        same = picked(self, "rate_hz", "frames", "sha256", "channels", "notes")
        return self.figures() | dict(self.about) | same | {"felt": self.felt and self.felt.figures()}


@contextmanager
def signal_of(source: Path, job: RenderJob, workspace: Path | None = None) -> Iterator[Signal]:
    """Yield what a source asks of the display. workspace: as for `speech_signal`."""
    match kind_of_source(source):
        case "clip":
            yield clip_signal(read_clip(source, job.legacy), job.controller, job.level_db_sl)
        case "alignment":
            yield taps_signal(read_textgrid(source), job.controller, job.level_db_sl, job.layout)
        case _ if job.live:
            yield live_signal(source, job.controller, job.coding, job.level_db_sl)
        case _:
            with speech_signal(source, job.controller, job.coding, job.level_db_sl, workspace) as signal:
                yield signal


def source_of(source: Path, job: RenderJob) -> dict[str, Any]:
    """Return what a reference states of where it came from: a source's name and content, and the job's settings.

    Raises BadInput for a source that is no file: a pipe could not be read once more.
    """
    if not source.is_file():
        what = "it is a folder" if source.is_dir() else "it is no file" if source.exists() else "file not found"
        raise BadInput(f"{source}: {what}")
    digest = hashlib.sha256()
    with source.open("rb") as file:
        while part := file.read(1 << 20):
            digest.update(part)
    return {"source": source.name, "source_sha256": digest.hexdigest(), **job.settings(kind_of_source(source))}


def render_file(
    source: str | Path,
    out: str | Path,
    job: RenderJob,
    felt_out: str | Path | None = None,
    progress: Progress = lambda done: None,
) -> Rendered:
    """Render `source` to the reference `out`, and what is felt of it to `felt_out`; files appear whole or not at all.

    felt_out (which asks for the simulation) holds the displacement weighted by the inverse threshold curve, in
    threshold units like the reference itself. Raises BadInput for a source that is refused, and as `write_reference`
    does.
    """
    source, out, felt_out = Path(source), Path(out), None if felt_out is None else Path(felt_out)
    for path in (out, felt_out):
        if path is not None:
            check_suffix(path)
    if felt_out is not None and felt_out.resolve() == out.resolve():
        raise BadInput(f"`felt` and `out` are both {out}", "two files")
    provenance = source_of(source, job)
    with signal_of(source, job, out.parent) as signal:
        return write_signal(signal, out, job, provenance, felt_out, progress)


def write_signal(
    signal: Signal,
    out: Path,
    job: RenderJob,
    provenance: Mapping[str, Any],
    felt_out: Path | None = None,
    progress: Progress = lambda done: None,
) -> Rendered:
    """Write a signal within the display's limits; `felt_out` and `progress` as for `render_file`."""
    controller = job.controller
    channels = controller.display.channels
    band = (min(c.threshold.band_hz[0] for c in channels), max(c.threshold.band_hz[1] for c in channels))
    names = tuple(channel.name for channel in channels)
    head = ReferenceHead(controller.rate_hz, names, curves_of(channels), band, provenance=provenance)
    limiter, delivered, peaks = Limiter(controller), list[FloatArray](), np.zeros(len(channels))
    with ExitStack() as stack:
        writer = stack.enter_context(write_reference(out, head, signal.frames))

        def written() -> Iterator[FloatArray]:
            for stretch in limiter.process(signal.blocks):
                if signal.loss is not None:
                    delivered.append(stretch)
                block = stretch.astype(np.float32).astype(np.float64)
                writer.write(block)
                np.maximum(peaks, np.abs(block.T).max(axis=1, initial=0.0), out=peaks)
                progress(writer.frames / max(1, signal.frames))
                yield block

        sink, felt = None, None
        if felt_out is not None:
            what = {"what": "felt: displacement weighted by the inverse threshold curve"}
            felt_head = replace(head, provenance=what | dict(provenance))
            sink = stack.enter_context(write_reference(felt_out, felt_head, signal.frames)).write
        if felt_out is not None or job.simulate:
            felt = compare_felt(SimulatedRig(controller.display, job.seed), controller, written(), sink)
        else:
            deque(written(), maxlen=0)
        with np.errstate(divide="ignore"):
            peak_db_sl = dict(zip(names, (20.0 * np.log10(peaks)).tolist(), strict=True))
        loss = None if signal.loss is None else signal.loss(np.concatenate(delivered)[: signal.frames])
        rendered = Rendered(
            signal.frames, controller.rate_hz, names, peak_db_sl, limiter.report, writer.sha256,
            signal.about, signal.notes, loss, felt,
        )  # fmt: skip
        writer.rendered = rendered.figures()
    return rendered

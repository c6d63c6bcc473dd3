"""A speech file to a reference: coded, set to a level, limited, streamed from the first sample to the last; and what is
felt of it.

The level of an utterance is the rms, in dB SL, of its frames within 30 dB of the loudest. As everywhere, a level is
that of the sinusoid of the same rms: a sinusoid of amplitude 1 threshold unit is at 0 dB SL, so a frame of rms x is at
20 log10(sqrt(2) x).
"""

from __future__ import annotations

import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np

from tactuator import __version__
from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceHead, check_suffix, curves_of, write_reference
from tactuator.measure.felt import FeltReport, compare_felt
from tactuator.model.controller import Controller
from tactuator.perception.curve import check_level
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.decibels import db
from tactuator.speech.band_codings import DirectCoding
from tactuator.speech.coding import Coding, coding_document
from tactuator.speech.limiter import FingerLimiting, Limiter
from tactuator.speech.options import LEVEL_DB_SL
from tactuator.speech.reading import SpeechFile, scan_speech, speech_blocks
from tactuator.table import brief, picked

FRAME_S = 0.025
FRAMES_WITHIN_DB = 30.0


@dataclass
class LevelMeter:
    """Takes blocks (n, channels) one after the other and keeps only the frames' powers (0.025 s each)."""

    rate_hz: float
    _powers: list[FloatArray] = field(default_factory=list)
    _rest: FloatArray | None = None

    def push(self, block: FloatArray) -> None:
        """Add a block to the frames counted."""
        length = round(FRAME_S * self.rate_hz)
        block = block if self._rest is None else np.concatenate((self._rest, block))
        whole = len(block) // length
        frames = block[: whole * length].reshape(whole, length, block.shape[1])
        self._powers.append(np.einsum("ijk,ijk->ik", frames, frames) / length)
        self._rest = block[whole * length :].copy()

    def level_db(self) -> float:
        """Return the level of the loudest channel over its frames within 30 dB of its loudest frame; -inf for silence.

        Raises BadInput where not one frame was whole.
        """
        powers = np.concatenate(self._powers) if self._powers else np.zeros((0, 1))
        if not len(powers):
            raise BadInput("shorter than one frame", f"{1e3 * FRAME_S:g} ms or longer")
        best = max(_active_power(channel) for channel in powers.T)
        with np.errstate(divide="ignore"):
            return float(10.0 * np.log10(2.0 * best))


def _active_power(powers: FloatArray) -> float:
    loudest = float(powers.max())
    return float(powers[powers >= loudest * 10.0 ** (-FRAMES_WITHIN_DB / 10.0)].mean())


QUIETEST_DB, LEAST_DB = -90.0, -60.0
"""Of full scale, and of a file's peak: a coding that leaves less than either of a file has found nothing in it."""
RAMP_S = 0.02
KEPT_S = 60.0
"""What is coded of a file no longer waits in memory."""
BLOCK_S = 4.0


@dataclass(frozen=True, eq=False)
class Rendering:
    """A speech file on its way to a reference; made by `rendering`. gain: threshold units per full scale."""

    speech: SpeechFile
    controller: Controller
    level_db_sl: float
    gain: float
    frames: int
    _coded: IO[bytes]
    _placement: FloatArray
    _limiter: Limiter

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the display's channels, in the order of the blocks' columns."""
        return tuple(channel.name for channel in self.controller.display.channels)

    @property
    def limiting(self) -> tuple[FingerLimiting, ...]:
        """Return the limiting so far, finger by finger."""
        return self._limiter.report

    def blocks(self) -> Iterator[FloatArray]:
        """Yield the reference in blocks (n, channels), threshold units, float32 numbers; once only."""
        for stretch in self._limiter.process(self._levelled()):
            yield stretch.astype(np.float32).astype(np.float64)

    def _levelled(self) -> Iterator[FloatArray]:
        matrix, width = self.gain * self._placement, len(self._placement)
        length = 4 * width * round(BLOCK_S * self.controller.rate_hz)
        self._coded.seek(0)
        read = (np.frombuffer(data, dtype=np.float32) for data in iter(lambda: self._coded.read(length), b""))
        blocks = (block.reshape(-1, width).astype(np.float64) for block in read)
        for block in _ramped(blocks, self.frames, self.controller.rate_hz):
            # finger by finger in memory, as the limiter looks at them
            yield np.multiply.outer(matrix[0], block[:, 0]).T if width == 1 else block @ matrix


def _ramped(blocks: Iterable[FloatArray], frames: int, rate_hz: float) -> Iterator[FloatArray]:
    """Yield blocks, `frames` samples in all, that rise from zero at their beginning and fall to zero at their end."""
    ramp, at = min(round(RAMP_S * rate_hz), frames // 2), 0
    rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(ramp) + 0.5) / max(ramp, 1))
    for block in blocks:
        gain, last = rise.reshape(-1, *[1] * (block.ndim - 1)), frames - at
        if at < ramp:
            count = min(ramp - at, len(block))
            block[:count] *= gain[at : at + count]
        if len(block) > last - ramp:
            index = last - 1 - np.arange(max(0, last - ramp), len(block))
            block[max(0, last - ramp) :] *= gain[index]
        at += len(block)
        yield block


@contextmanager
def rendering(
    path: str | Path,
    controller: Controller,
    coding: Coding | None = None,
    level_db_sl: float = LEVEL_DB_SL,
    workspace: str | Path | None = None,
) -> Iterator[Rendering]:
    """Read and code a speech file, and find its level; then `.blocks()` gives the reference.

    What is coded of a long file waits in an unnamed one in the folder `workspace` (the system's by default), so that
    memory does not grow with the speech. Raises BadInput for a file that is refused (see `scan_speech`), a level that
    is not below comfort, a rate that is not a whole number of hertz, or speech in which the coding finds nothing.
    """
    coding = DirectCoding() if coding is None else coding
    check_level(level_db_sl)
    rate = controller.rate_hz
    if rate != int(rate):
        raise BadInput(f"display runs at {rate:g} Hz; allowed for speech: a whole number of hertz")
    placement = coding.placement(tuple(channel.finger for channel in controller.display.channels))
    speech = scan_speech(path)
    try:
        is_short = speech.duration_s <= KEPT_S
        room = BytesIO() if is_short else tempfile.TemporaryFile(dir=workspace)  # noqa: SIM115 (entered below)
    except OSError as error:
        raise BadInput(f"{workspace}: {error.strerror}", "a folder that can be written") from None
    with room as coded:
        meter, frames = LevelMeter(rate), 0
        try:
            # where a sound is cut, it has all frequencies: what lies outside of the band would be a click in it
            sound = _ramped(speech_blocks(speech), speech.frames, speech.rate_hz)
            for block in coding.signals(sound, speech.rate_hz, int(rate)):
                coded.write(np.ascontiguousarray(block, dtype=np.float32).data)
                meter.push(block if len(placement) == 1 else block @ placement)
                frames += len(block)
        except OSError as error:
            raise BadInput(f"{path}: no room to work in ({error.strerror})", "a disk with room") from None
        level, least = meter.level_db(), max(QUIETEST_DB, float(db(speech.peak)) + LEAST_DB)
        if level < least:
            said = f"coding {coding.kind!r} leaves {level:.0f} dB re full scale of it"
            raise BadInput(f"{path}: nothing of this sound lies in the band: {said}", f"{least:.0f} dB or more")
        gain = float(10.0 ** ((level_db_sl - level) / 20.0))
        yield Rendering(speech, controller, level_db_sl, gain, frames, coded, placement, Limiter(controller))


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

    __repr__ = brief

    def document(self) -> dict[str, Any]:
        """Return the figures in plain JSON."""
        limiter = {each.finger: {k: v for k, v in vars(each).items() if k != "finger"} for each in self.limiting}
        return {
            "speech": str(self.speech.path),
            **picked(self.speech, "encoding", "duration_s"),
            **picked(self, "rate_hz", "frames", "peak_db_sl", "sha256", threshold_units_per_speech_full_scale="gain"),
            "notes": list(self.speech.notes),
            "channels": list(self.channels),
            "limiter": limiter,
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
        sink, felt, peaks = None, None, np.zeros(len(making.channels))

        def written() -> Iterator[FloatArray]:
            for block in making.blocks():
                writer.write(block)
                np.maximum(peaks, np.abs(block.T).max(axis=1, initial=0.0), out=peaks)
                progress(writer.frames / max(1, making.frames))
                yield block

        if felt_out is not None:
            what = {"what": "felt: displacement weighted by the inverse threshold curve"}
            felt_head = replace(head, provenance=what | dict(head.provenance))
            sink = stack.enter_context(write_reference(felt_out, felt_head, making.frames)).write
        if felt_out is not None or job.simulate:
            felt = compare_felt(SimulatedRig(controller.display, job.seed), controller, written(), sink)
        else:
            deque(written(), maxlen=0)
    with np.errstate(divide="ignore"):
        peak_db_sl = dict(zip(making.channels, (20.0 * np.log10(peaks)).tolist(), strict=True))
    same = picked(making, "speech", "frames", "channels", "gain", "limiting")
    return Rendered(rate_hz=controller.rate_hz, peak_db_sl=peak_db_sl, sha256=writer.sha256, felt=felt, **same)


def _head(making: Rendering, job: RenderJob) -> ReferenceHead:
    channels = job.controller.display.channels
    band = (min(c.threshold.band_hz[0] for c in channels), max(c.threshold.band_hz[1] for c in channels))
    provenance = {
        "speech": making.speech.path.name,
        "speech_rate_hz": making.speech.rate_hz,
        "speech_frames": making.speech.frames,
        "notes": list(making.speech.notes),
        **job.parameters(),
    }
    return ReferenceHead(job.controller.rate_hz, making.channels, curves_of(channels), band, provenance=provenance)

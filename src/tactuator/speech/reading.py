"""Speech files as a stream of mono blocks: what libsndfile reads, any rate, any number of channels.

A file is looked at once before anything is made of it (`scan_speech`): every refusal comes from there, so nothing
half-written is left behind by a file that turns out bad at its end.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.kinds import require_kind
from tactuator.io.sound import (
    UNKNOWN_FRAMES,
    frames_held,
    is_indexed,
    length_remarks,
    opened_sound,
    require_whole,
    without_remarks,
)

BLOCK_FRAMES, KEPT_BYTES = 1 << 16, 1 << 25
"""So many frames go together; a file of no more than the second is read once."""
SHORTEST_S = 0.1
LOWEST_RATE_HZ, HIGHEST_RATE_HZ = 1000, 768_000
SMALLEST_SWING = 1e-4
"""Peak about the mean, of full scale 1: below -80 dB the converters' own noise is all there is."""

LARGEST_SWING = 1e6
"""Peak about the mean, of full scale 1, that a file of floats may have: beyond it is no sound, but a mistake."""

CANCELS_DB = 20.0
"""Loss by mixing from which on it is reported: channels of one voice lose 3 dB at most."""
_CLIPPED_STEP, _CLIPPED_SHARE, _CLIPPED_RUNS, _FINE_STEP = 0.01, 0.99, 3, 1e-4
"""Clipped: a step of 1 % of the peak or more, and then three equal samples at the peak of its sign (within a step of 8
bits), three times or more. A smooth peak is reached by smaller steps. Of 8 bits a step is of full scale."""

_COARSE = ("PCM_U8", "PCM_S8", "ULAW", "ALAW")
_Samples = NDArray[np.float64 | np.int16]
_UNIT = {np.dtype(np.float64): 1.0, np.dtype(np.int16): 2.0**-15}
"""Of full scale: whole numbers of 16 bits are read in a fifth of the time, and come to the same signal."""


@dataclass(frozen=True)
class SpeechFile:
    """A speech file that has been read through once and found good.

    mean: of the mono signal, taken out on reading. peak: of the mono signal about its mean; full scale is 1.
    notes: what was done to it that a user would want to know, one line each. kept: what was read of a short file.
    """

    path: Path
    rate_hz: int
    frames: int
    channels: int
    encoding: str
    mean: float
    peak: float
    notes: tuple[str, ...] = ()
    kept: tuple[_Samples, ...] = field(default=(), repr=False, compare=False)

    @property
    def duration_s(self) -> float:
        """Return the length in seconds."""
        return self.frames / self.rate_hz


def sample_path() -> Path:
    """Return the path of the shipped sample: two short phrases by formant synthesis."""
    return Path(str(files("tactuator.speech").joinpath("data", "sample.wav")))


def sentence_path() -> Path:
    """Return the path of a recorded sentence: LibriVox, Sense and Sensibility, chapter 1, in the public domain."""
    return Path(str(files("tactuator.speech").joinpath("data", "sentence.flac")))


def scan_speech(path: str | Path) -> SpeechFile:
    """Read `path` through and return what it is.

    Raises BadInput for a file that is missing, empty, not sound, truncated, shorter than 0.1 s, constant (silence or
    DC), or that holds NaN or infinite samples.
    """
    path = Path(path)
    require_kind(path, "sound")
    remarks = _check_bytes(path)
    try:
        with without_remarks(path), opened_sound(path) as file:
            rate, frames, channels = file.samplerate, file.frames, file.channels
            encoding = f"{file.format} {file.subtype}"
            _check_header(path, rate, frames)
            found = _scan_samples(path, file)
    except soundfile.LibsndfileError as error:
        reason = str(error.error_string).strip().rstrip(".")
        raise BadInput(f"{path}: not readable as sound ({reason})", "WAV, FLAC, Ogg, AIFF, ...") from None
    if frames < UNKNOWN_FRAMES and is_indexed(path) and found.frames != frames:
        raise BadInput(f"{path}: truncated, {found.frames} of {frames} frames are there", "a whole file")
    if found.frames < (held := frames_held(path)):
        raise BadInput(
            f"{path}: {found.frames} of {held} samples or more can be decoded", "one that `ffmpeg` wrote anew"
        )
    _check_header(path, rate, found.frames)
    mean = found.mean
    peak = max(found.high - mean, mean - found.low)
    if peak < SMALLEST_SWING:
        silent = "silent" if channels == 1 else f"silent once its {channels} channels are mixed"
        what = silent if abs(mean) < SMALLEST_SWING else f"constant at {mean:.4g} of full scale (DC)"
        raise BadInput(f"{path}: {what}", f"a signal with a peak of at least {SMALLEST_SWING:g} about its mean")
    if peak > LARGEST_SWING:
        raise BadInput(f"{path}: a peak of {peak:.3g} times full scale", f"up to {LARGEST_SWING:g}")
    notes = (*remarks, *_notes(found, channels, peak))
    return SpeechFile(path, rate, found.frames, channels, encoding, mean, peak, notes, tuple(found.kept))


def speech_blocks(speech: SpeechFile, block_frames: int = BLOCK_FRAMES) -> Iterator[FloatArray]:
    """Yield the file's mono signal (mean of its channels, its mean taken out) in blocks (n,), n <= block_frames."""
    if speech.kept and block_frames == BLOCK_FRAMES:
        yield from (_signal(block, speech.mean) for block in speech.kept)
        return
    with ExitStack() as stack:
        with without_remarks(speech.path):
            file = stack.enter_context(opened_sound(speech.path))
        for block in _read(file, block_frames):
            yield _signal(_mixed(block), speech.mean)


def _signal(block: _Samples, mean: float) -> FloatArray:
    return np.asarray(block * _UNIT[block.dtype] - mean)


def _check_bytes(path: Path) -> tuple[str, ...]:
    """Return where the head and the content disagree. Raises BadInput for no file, or one that ends early."""
    if not path.is_file():
        raise BadInput(f"{path}: {'it is a folder' if path.is_dir() else 'file not found'}")
    if path.suffix.lower() == ".raw":
        raise BadInput(f"{path}: samples without a head", "WAV, FLAC, Ogg, AIFF, ..., as `sox` makes of them")
    try:
        size = path.stat().st_size
        require_whole(path)
        remarks = length_remarks(path)
    except BadInput as error:
        raise error.within(f"{path}") from None
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror})", "a readable sound file") from None
    if size == 0:
        raise BadInput(f"{path}: empty, 0 bytes", "a sound file")
    return remarks


def _check_header(path: Path, rate: int, frames: int) -> None:
    if not LOWEST_RATE_HZ <= rate <= HIGHEST_RATE_HZ:
        raise BadInput(f"{path}: sampled at {rate} Hz", f"{LOWEST_RATE_HZ} to {HIGHEST_RATE_HZ} Hz")
    if frames < SHORTEST_S * rate:
        raise BadInput(f"{path}: {frames} frames, {1e3 * frames / rate:.4g} ms", f"{1e3 * SHORTEST_S:g} ms or longer")


def _read(file: soundfile.SoundFile, block_frames: int) -> Iterator[_Samples]:
    """Yield blocks (n, channels)."""
    dtype = "int16" if file.subtype == "PCM_16" and file.channels == 1 else "float64"
    while len(block := file.read(block_frames, dtype=dtype, always_2d=True)):
        yield block


def _mixed(block: _Samples) -> _Samples:
    return block[:, 0] if block.shape[1] == 1 else block.mean(axis=1)


@dataclass
class _Found:
    """What one reading of a file finds. powers: sum of squares of the mix, and of all channels' mean power. flat: of
    runs of equal samples behind a step, how many of each value. extremes: of all channels. least_step: that counts.
    """

    least_step: float

    frames: int = 0
    total: float = 0.0
    low: float = np.inf
    high: float = -np.inf
    mixed_power: float = 0.0
    channel_power: float = 0.0
    flat: Counter[float] = field(default_factory=Counter)
    extremes: tuple[float, float] = (0.0, 0.0)
    kept: list[_Samples] = field(default_factory=list)

    @property
    def mean(self) -> float:
        """Return the mean of the mono signal."""
        return self.total / max(self.frames, 1)

    def take(self, block: _Samples, mono: _Samples) -> None:
        """Add a block to the figures."""
        unit = _UNIT[block.dtype]
        self.low, self.high = min(self.low, unit * float(mono.min())), max(self.high, unit * float(mono.max()))
        self.frames += len(block)
        if block.shape[1] > 1:
            self.mixed_power += float(np.sum(mono**2))
            self.channel_power += float(np.mean(np.sum(block**2, axis=0)))
        self.extremes = (
            min(self.extremes[0], unit * float(block.min())),
            max(self.extremes[1], unit * float(block.max())),
        )
        steps = unit * np.abs(np.diff(block.astype(np.float64), axis=0))
        values = unit * block[1:-2].astype(np.float64)
        large = steps[:-2] > np.maximum(_CLIPPED_STEP * np.abs(values), self.least_step)
        self.flat.update(values[large & (steps[1:-1] == 0.0) & (steps[2:] == 0.0)].tolist())

    def clipped(self) -> Iterator[tuple[int, float]]:
        """Yield how many peaks are cut off, and where, of either sign."""
        for peak in self.extremes:
            count = sum(many for value, many in self.flat.items() if value / (peak or 1.0) >= _CLIPPED_SHARE)
            if count >= _CLIPPED_RUNS:
                yield count, abs(peak)


def _scan_samples(path: Path, file: soundfile.SoundFile) -> _Found:
    found = _Found(_FINE_STEP if file.subtype not in _COARSE else _CLIPPED_STEP)
    for block in _read(file, BLOCK_FRAMES):
        mono = _mixed(block)
        found.total += _UNIT[block.dtype] * float(mono.sum())
        if not np.isfinite(found.total):
            bad = np.flatnonzero(~np.isfinite(mono))
            at = (found.frames + int(bad[0])) / file.samplerate if bad.size else found.frames / file.samplerate
            raise BadInput(f"{path}: a sample at {at:.3f} s is not a finite number", "finite samples")
        found.take(block, mono)
        if file.frames * mono.itemsize <= KEPT_BYTES:
            found.kept.append(mono)
    return found


def _notes(found: _Found, channels: int, peak: float) -> Iterator[str]:
    if channels > 1:
        yield f"{channels} channels mixed down to one (their mean)"
        lost_db = 10.0 * np.log10(max(found.channel_power, 1e-300) / max(found.mixed_power, 1e-300))
        if lost_db > CANCELS_DB:
            yield f"the channels cancel: their mean is {lost_db:.0f} dB below them; is one reversed?"
    if abs(found.mean) > 0.01 * peak:
        yield f"a mean of {found.mean:.4g} of full scale (DC) was taken out"
    if cut := list(found.clipped()):
        peaks = sum(count for count, _ in cut)
        yield f"clipping is likely: {peaks} peaks are cut off at {cut[-1][1]:.3g} of full scale"

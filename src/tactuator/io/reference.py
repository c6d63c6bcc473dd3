"""Reading and writing of references: signals to be played, in threshold units, one column a channel.

A WAV is float32 in which 1.0 is a stated level (60 dB SL: amplitude 1000); the level is in its INFO comment
and, with curves, band and provenance, in NAME.json beside it. An HDF5 file holds threshold units themselves in the
dataset `reference` (n, channels), and everything else as attributes.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import h5py
import numpy as np
import soundfile
from numpy.typing import NDArray
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.atomic import atomic_path, write_text
from tactuator.io.hdf5 import opened_hdf5, written_hdf5
from tactuator.io.kinds import require_kind, require_replaceable
from tactuator.io.sound import forget_time, require_whole, without_remarks
from tactuator.io.text import read_finite_json
from tactuator.model.description import Channel
from tactuator.parameters import Number, Positive, table
from tactuator.plain import brief, plain

FULL_SCALE_DB_SL = 60.0
BLOCK_FRAMES = 1 << 14
SUFFIXES = (".wav", ".h5", ".hdf5")
SHORT_WAV_BYTES, LARGEST_WAV_BYTES = 1 << 20, (1 << 32) - (1 << 16)
FORMAT = "tactuator-reference/1"
MOST_CHUNK_VALUES = 1 << 24
"""Numbers of one chunk of an HDF5 file, which is read as a whole: 64 MB."""


@table("scale")
class ReferenceHead:
    """The statement of a reference about itself. curves: channel -> (name, SHA-256 of points); provenance: JSON."""

    rate_hz: Positive
    channels: tuple[str, ...]
    curves: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    band_hz: tuple[Number, Number] | None = None
    full_scale_db_sl: Annotated[float, Field(strict=True, ge=-1000.0, le=1000.0)] = FULL_SCALE_DB_SL
    provenance: Mapping[str, Any] = field(default_factory=dict)

    __repr__ = brief

    @property
    def full_scale(self) -> float:
        """Return the number of threshold units of 1.0 in a WAV."""
        return float(10.0 ** (self.full_scale_db_sl / 20.0))

    def document(self) -> dict[str, Any]:
        """Return the content of NAME.json."""
        named = {name: {"name": curve, "hash": digest} for name, (curve, digest) in self.curves.items()}
        return {"format": FORMAT, **plain(self), "curve": next(iter(named.values()), None), "curves": named}

    @classmethod
    def of_document(cls, document: Mapping[str, Any]) -> ReferenceHead:
        """Return the head of a NAME.json. Raises BadInput, LookupError or TypeError for what is none."""
        known = {key: document[key] for key in cls.__dataclass_fields__ if key in document}
        curves = {name: (curve["name"], curve["hash"]) for name, curve in known.get("curves", {}).items()}
        return cls(**known | {"curves": curves})

    def comment(self) -> str:
        """Return the content of a WAV's INFO comment."""
        curve = ",".join(sorted({name for name, _ in self.curves.values()}))
        return (
            f"tactuator reference: 1.0 = {self.full_scale_db_sl:g} dB SL; channels {','.join(self.channels)}; "
            f"curve {curve or 'unknown'}"
        )


def curves_of(channels: Iterable[Channel]) -> dict[str, tuple[str, str]]:
    """Return name and hash of the curve of every channel, as a head states them."""
    return {c.name: (c.threshold.curve.name, c.threshold.curve.content_hash) for c in channels}


class ReferenceWriter:
    """Takes blocks (n, channels) in threshold units; made by `write_reference`. rendered: figures of how the reference
    came about, plain JSON, which are written with its head.
    """

    def __init__(self, sink: Any, head: ReferenceHead, path: Path, check: Callable[[], None] = lambda: None) -> None:
        self._sink, self._head, self._path, self._check = sink, head, path, check
        self._digest = hashlib.sha256()
        self.frames = 0
        self.rendered: Mapping[str, Any] = {}

    @property
    def sha256(self) -> str:
        """Return SHA-256 (hex) of the samples so far; see `content_sha256`."""
        return self._digest.hexdigest()

    def document(self) -> str:
        """Return the content of NAME.json: the head, the checksum of the samples, and what was rendered."""
        document = {**self._head.document(), "sha256": self.sha256, "rendered": self.rendered}
        return json.dumps(document, indent=1, allow_nan=False) + "\n"

    def write(self, block: FloatArray) -> None:
        """Append a block. Raises BadInput for another shape, samples that are not finite, or where it cannot go."""
        if block.ndim != 2 or block.shape[1] != len(self._head.channels):
            raise BadInput(f"reference block of shape {block.shape}", f"(n, {len(self._head.channels)})")
        if not np.all(np.isfinite(block)):
            raise BadInput("reference block holds a sample that is not finite", "finite threshold units")
        with _writing(self._path):
            self._append(block)
        self.frames += len(block)

    def _append(self, block: FloatArray) -> None:
        shares = sample_shares(block, self._head)
        if isinstance(self._sink, soundfile.SoundFile):
            after = (self.frames + len(block)) * 4 * block.shape[1]
            if after > LARGEST_WAV_BYTES:
                raise BadInput(
                    f"{self._path}: more than 4 GB; allowed in a WAV: less (an .h5 may be as long as the disk)"
                )
            self._sink.write(shares)
        else:
            self._sink.resize(self.frames + len(block), axis=0)
            self._sink[self.frames :] = block.astype(np.float32)
            self._check()
        self._digest.update(shares.data)


class _SoundWriter(soundfile.SoundFile):  # type: ignore[misc]
    """A sound file that does not wait for the disk when it is closed; no other file of ours does."""

    def flush(self) -> None:
        """Leave it to the system when what was written goes to the disk."""


@contextmanager
def write_reference(path: str | Path, head: ReferenceHead, frames: int = 0) -> Iterator[ReferenceWriter]:
    """Yield a writer of `path` (.wav, .h5, .hdf5); the file and its NAME.json appear whole at the end, or not at all.

    frames: how many are to come, where that is known: room for many is asked for before anything is written. Raises
    BadInput for another ending, a rate that is not a whole number of hertz (WAV), or a full disk.
    """
    path = Path(path)
    check_suffix(path)
    if path.suffix == ".wav" and head.rate_hz != int(head.rate_hz):
        raise BadInput(f"{path}: rate {head.rate_hz:g} Hz; allowed in a WAV: a whole number of hertz")
    head_path = path.with_suffix(".json")
    if path.suffix == ".wav":
        require_replaceable(head_path, "reference")
    with atomic_path(path, "reference") as beside:
        with _writing(path):
            _require_room(beside, frames, len(head.channels))
        if path.suffix == ".wav":
            with (
                _writing(path),
                _SoundWriter(beside, "w", int(head.rate_hz), len(head.channels), "FLOAT", format="WAV") as file,
            ):
                file.comment = head.comment()
                writer = ReferenceWriter(file, head, path)
                yield writer
            forget_time(beside)
            write_text(head_path, writer.document(), "reference")
        else:
            with _writing(path), written_hdf5(beside) as written:
                writer = ReferenceWriter(_dataset(written.file, head), head, path, written.check)
                yield writer
                written.file.attrs["head"] = writer.document()


def check_suffix(path: Path) -> None:
    """Raise BadInput unless `path` ends as a reference does."""
    if path.suffix not in SUFFIXES:
        raise BadInput(f"reference {path}: ending {path.suffix!r}", f"{', '.join(SUFFIXES)}")


@dataclass(frozen=True)
class ReferenceFile:
    """A reference that can be read."""

    path: Path
    head: ReferenceHead
    frames: int

    __repr__ = brief

    @property
    def duration_s(self) -> float:
        """Return the length of the reference, seconds."""
        return self.frames / self.head.rate_hz

    def blocks(self, block_frames: int = BLOCK_FRAMES) -> Iterator[FloatArray]:
        """Yield the reference in blocks (n, channels), threshold units."""
        if self.path.suffix == ".wav":
            with soundfile.SoundFile(self.path) as file:
                read = 0
                while len(block := file.read(block_frames, dtype="float64", always_2d=True)):
                    read += len(block)
                    yield _finite(block * self.head.full_scale, self.path)
                if read < self.frames:
                    raise BadInput(f"reference {self.path}: {read} of {self.frames} frames", "a whole file")
        else:
            with h5py.File(self.path) as file:
                for start in range(0, self.frames, block_frames):
                    yield _finite(_rows(file["reference"], start, block_frames, self.path), self.path)


def open_reference(path: str | Path) -> ReferenceFile:
    """Look at a reference; BadInput, one line, if it is missing, not one, or does not say its scale."""
    path = Path(path)
    require_kind(path, "reference", "sound")  # the scale that a sound lacks is named below
    check_suffix(path)
    try:
        if not path.is_file():
            raise BadInput("file not found")
        return _open_wav(path) if path.suffix == ".wav" else _open_hdf5(path)
    except BadInput as error:
        raise error.within(f"reference {path}") from None
    except (soundfile.LibsndfileError, OSError, LookupError, TypeError, ValueError, ArithmeticError, RuntimeError,
            AttributeError):  # fmt: skip
        raise BadInput(f"reference {path}: cannot be read as one", "a file that `render` wrote") from None


def content_sha256(path: str | Path) -> str:
    """Return SHA-256 (hex) of a reference's samples as a WAV holds them (`sample_shares`), in any kind of file."""
    reference, digest = open_reference(path), hashlib.sha256()
    for block in reference.blocks():
        digest.update(sample_shares(block, reference.head).data)
    return digest.hexdigest()


def sample_shares(block: FloatArray, head: ReferenceHead) -> NDArray[np.float32]:
    """Return a block (n, channels) of threshold units as little-endian float32 shares of full scale, row by row."""
    # column by column: numpy takes three times as long along short rows
    return np.asarray(np.stack(list(block.T / head.full_scale), axis=1, dtype=np.dtype("<f4"), casting="same_kind"))


def _dataset(file: h5py.File, head: ReferenceHead) -> Any:
    width = len(head.channels)
    data = file.create_dataset(
        "reference", shape=(0, width), maxshape=(None, width), chunks=(BLOCK_FRAMES, width), dtype="<f4"
    )
    data.attrs["units"] = "threshold units (a sinusoid of amplitude 1 is at 0 dB SL)"
    file.attrs["format"] = FORMAT
    file.attrs["rate_hz"] = head.rate_hz
    return data


def _require_room(beside: Path, frames: int, channels: int) -> None:
    """Raise OSError where so many frames do not fit: HDF5 does not survive to find out; a short WAV does, unasked."""
    wanted = -(-frames // BLOCK_FRAMES) * BLOCK_FRAMES * channels * 4 + (1 << 16) if frames else 0
    if wanted > (SHORT_WAV_BYTES if beside.suffix == ".wav" else 0) and hasattr(os, "posix_fallocate"):
        with beside.open("r+b") as file:
            try:
                os.posix_fallocate(file.fileno(), 0, wanted)
            except OSError as error:
                if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL):
                    raise
            finally:
                file.truncate(0)


_SYSTEM = 2
"""The code by which libsndfile says that the system refused, without the reason."""


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Turn the error of a full disk, or of a place that cannot be written, into BadInput of one line."""
    try:
        yield
    except BadInput:
        raise
    except (soundfile.LibsndfileError, OSError, RuntimeError) as error:  # HDF5 may notice only on closing
        refused = isinstance(error, soundfile.LibsndfileError) and error.code == _SYSTEM
        reason = "the system refuses it" if refused else getattr(error, "strerror", None) or str(error).splitlines()[0]
        raise BadInput(f"{path}: cannot be written ({reason})", "a place with room to write") from None
    except AssertionError:  # soundfile's own, where fewer frames were written than given
        raise BadInput(f"{path}: cannot be written (the disk is full)", "a place with room to write") from None


def _finite(block: FloatArray, path: Path) -> FloatArray:
    if not np.all(np.isfinite(block)):
        raise BadInput(f"reference {path}: a sample is not a finite number", "finite samples")
    return block


def _rows(data: h5py.Dataset, start: int, count: int, path: Path) -> FloatArray:
    try:
        with np.errstate(invalid="ignore"):  # a signalling NaN is refused as any other
            return np.asarray(data[start : start + count], dtype=np.float64)
    except (OSError, RuntimeError, ValueError) as error:
        raise BadInput(f"reference {path}: {str(error).splitlines()[0]}", "a whole file") from None


_WAVES = ("WAV", "WAVEX", "RF64", "W64")


def _open_wav(path: Path) -> ReferenceFile:
    require_whole(path)
    beside = path.with_suffix(".json")
    with without_remarks(path), soundfile.SoundFile(path) as file:
        if file.format not in _WAVES:
            raise BadInput(f"it is {file.format} inside", "WAV")
        rate, width, frames, comment = file.samplerate, file.channels, file.frames, file.comment
    if beside.is_file():
        head = ReferenceHead.of_document(read_finite_json(beside))
    else:
        scale = re.search(r"1\.0 = ([-+.0-9e]+) dB SL; channels ([^;]+);", comment or "")
        if scale is None:
            raise BadInput(
                f"no {beside.name} beside it and no scale in its INFO comment",
                "a file that says how many dB SL 1.0 is",
            )
        head = ReferenceHead(float(rate), tuple(scale[2].split(",")), full_scale_db_sl=float(scale[1]))
    if len(head.channels) != width or head.rate_hz != rate:
        stated = f"{len(head.channels)} at {head.rate_hz:g} Hz"
        raise BadInput(f"{width} channels at {rate} Hz, but its scale is for {stated}", "a scale that fits")
    return ReferenceFile(path, head, frames)


def _open_hdf5(path: Path) -> ReferenceFile:
    with opened_hdf5(path) as file:
        head = ReferenceHead.of_document(json.loads(str(file.attrs["head"])))
        data = file["reference"]
        shape = data.shape
        if data.dtype.kind != "f" or data.chunks is None or math.prod(data.chunks) > MOST_CHUNK_VALUES:
            raise BadInput(f"a dataset of {data.dtype} in chunks of {data.chunks}", "a file that `render` wrote")
        if data.compression is None and data.id.get_storage_size() < math.prod(shape) * data.dtype.itemsize:
            raise BadInput(f"fewer samples are there than it states, {shape[0]} frames", "a whole file")
    if len(shape) != 2 or shape[1] != len(head.channels):
        raise BadInput(f"dataset of shape {shape}", f"(n, {len(head.channels)})")
    return ReferenceFile(path, head, int(shape[0]))

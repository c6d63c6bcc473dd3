"""Sound files: the length that a head states, held against the bytes that are there, and a library's own remarks."""

from __future__ import annotations

import io
import os
import re
import struct
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import soundfile

from tactuator.errors import BadInput
from tactuator.io.sound_frames import (
    flac_frames,
    has_true_index,
    mpeg_remarks,
    mpeg_runs,
    require_whole_mpeg,
    require_whole_ogg,
)

_STREAMED = 0x7FFF0000
"""Lengths from here on, and 0, are written by a program that did not know the length: ffmpeg, sox, arecord."""
_HEAD_BYTES, _RIFF_BYTES, _OGG_BEGINS = 36, 12, 2
_FORMS = {b"RIFF": ("<", b"data"), b"RIFX": (">", b"data"), b"FORM": (">", b"SSND")}
_KNOWN = (b"RIFF", b"RIFX", b"RF64", b"FORM", b"fLaC", b"OggS", b"caff", b".snd", b"riff")
_QUIET = threading.RLock()
_TIMES_LONGER, _TAG_BYTES, _LOST_FRAMES = 64, 128, 4
"""Frames that a decoder may leave out of each run: the encoder's delay, and those that refer to what is not there."""
UNKNOWN_FRAMES = 1 << 62
"""Frames from which on a length is none: a FLAC of a stream states 0."""


def _is_streamed(length: int) -> bool:
    return length == 0 or length >= _STREAMED


class _ReadThrough(io.RawIOBase):
    """A file with another head. patches: bytes of it by their place. size: stated for its own."""

    def __init__(self, file: BinaryIO, patches: Mapping[int, bytes], size: int) -> None:
        self._file, self._patches, self._size = file, patches, size
        self._real = file.seek(0, os.SEEK_END)
        file.seek(0)

    def readinto(self, buffer: Any, /) -> int:
        at, view = self.tell(), memoryview(buffer).cast("B")
        if at >= max(self._real, self._size - _TAG_BYTES):  # MPEG's decoder looks for a tag at the end first
            view[:] = bytes(len(view))
            self._file.seek(at + len(view))
            return len(view)
        content = self._file.read(len(view))
        view[: len(content)] = content
        for place, patch in self._patches.items():
            for k, byte in enumerate(patch):
                if at <= place + k < at + len(content):
                    view[place + k - at] = byte
        return len(content)

    def tell(self) -> int:
        return self._file.tell()

    def seek(self, offset: int, whence: int = 0, /) -> int:
        if whence == os.SEEK_END:
            return self._file.seek(self._size + offset)
        return self._file.seek(offset, whence)

    def close(self) -> None:
        self._file.close()
        super().close()


class _Forward(soundfile.SoundFile):  # type: ignore[misc]  # the library has no types
    """A sound file read from its beginning on: without a length, the library fails to seek where it is at its end."""

    def seekable(self) -> bool:
        return bool(self.frames < UNKNOWN_FRAMES)


def _begins(head: bytes) -> int:
    """Return where the frames of an MP3 begin, behind its tag."""
    return 10 + sum((byte & 127) << 7 * (3 - k) for k, byte in enumerate(head[6:10])) if head[:3] == b"ID3" else 0


def is_indexed(path: Path) -> bool:
    """Return whether the length that the library gives is the file's own: an MP3 without an index is estimated."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if head[:4] in _KNOWN:
        return True
    if runs := mpeg_runs(path):
        return has_true_index(runs, _begins(head))
    with without_remarks(path):  # of free bit rate
        return bool(soundfile.info(str(path)).format != "MP3")


def length_remarks(path: Path) -> tuple[str, ...]:
    """Return where a file's head and what it holds disagree in how long it is. Raises OSError."""
    with path.open("rb") as file:
        head = file.read(4)
    if head == b"OggS":
        return () if require_whole_ogg(path) else ("no Ogg page is marked as the last: it may be cut off",)
    if head == b"fLaC":
        _, stated, held = flac_frames(path)
        return (f"its head states {stated} samples, {held} follow: all are read",) if held > stated > 0 else ()
    return tuple(mpeg_remarks(mpeg_runs(path))) if head not in _KNOWN else ()


def frames_held(path: Path) -> int:
    """Return how many samples an MP3 holds at least by its frames; 0 for another file."""
    with path.open("rb") as file:
        if file.read(4) in _KNOWN:
            return 0
    return sum(run.samples - _LOST_FRAMES * run.samples // run.frames for run in mpeg_runs(path))


@contextmanager
def opened_sound(path: Path) -> Iterator[soundfile.SoundFile]:
    """Yield the sound file, read to the end of its bytes where its head does not know the length."""
    with ExitStack() as stack:
        source = _source(path)
        if isinstance(source, _ReadThrough):
            stack.enter_context(source)
        yield stack.enter_context(_Forward(source))


def _source(path: Path) -> Path | _ReadThrough:
    size = path.stat().st_size
    if not is_indexed(path):
        file = io.BytesIO(_frames_of(path)) if mpeg_runs(path) else path.open("rb")
        return _ReadThrough(file, {}, _TIMES_LONGER * size + _TAG_BYTES)  # the estimate goes by the first frames
    with path.open("rb") as file:
        head = file.read(_RIFF_BYTES)
        if head[:4] in (b"RIFF", b"RIFX"):
            order, wanted = _FORMS[head[:4]]
            while len(chunk := file.read(8)) == 8:
                (length,) = struct.unpack(f"{order}I", chunk[4:])
                begins = file.tell()
                if chunk[:4] == wanted and _is_streamed(length) and not 0 < length <= size - begins:
                    real = struct.pack(f"{order}I", min(size - begins, 0xFFFFFFFE))
                    return _ReadThrough(
                        path.open("rb"), {4: struct.pack(f"{order}I", size - 8), begins - 4: real}, size
                    )
                if chunk[:4] == wanted:
                    break
                file.seek(length + length % 2, 1)
        elif head[:4] in _UNKNOWN_LENGTH and (patches := _UNKNOWN_LENGTH[head[:4]](file, size)):
            return _ReadThrough(path.open("rb"), patches, size)
    return path


def _frames_of(path: Path) -> bytes:
    """Return the frames of sound of an MP3, without what lies between them and without an index."""
    content = path.read_bytes()
    return b"".join(content[run.begin : run.end] for run in mpeg_runs(path))


def _patches_of_flac(file: BinaryIO, size: int) -> dict[int, bytes]:
    at, stated, held = flac_frames(Path(file.name))
    if not held > stated > 0:
        return {}
    file.seek(at)
    return {at: bytes([file.read(1)[0] & 0xF0, 0, 0, 0, 0])}


def _patches_of_au(file: BinaryIO, size: int) -> dict[int, bytes]:
    file.seek(4)
    begins, length = struct.unpack(">II", file.read(8))
    return {8: struct.pack(">I", size - begins)} if _is_streamed(length) else {}


def _patches_of_caf(file: BinaryIO, size: int) -> dict[int, bytes]:
    file.seek(8)
    while len(chunk := file.read(12)) == 12:
        (length,) = struct.unpack(">q", chunk[4:])
        if chunk[:4] == b"data" or length < 0:
            return {file.tell() - 8: struct.pack(">q", size - file.tell())} if length == -1 else {}
        file.seek(min(length, 1 << 62), 1)
    return {}


def _patches_of_rf64(file: BinaryIO, size: int) -> dict[int, bytes]:
    file.seek(_RIFF_BYTES)
    head = file.read(24)
    if head[:4] != b"ds64" or struct.unpack("<Q", head[16:])[0] not in _UNKNOWN_64:
        return {}
    file.seek(_RIFF_BYTES)
    while len(chunk := file.read(8)) == 8:
        if chunk[:4] == b"data":
            return {20: struct.pack("<QQ", size - 8, size - file.tell())}
        file.seek(struct.unpack("<I", chunk[4:])[0], 1)
    return {}


def _patches_of_w64(file: BinaryIO, size: int) -> dict[int, bytes]:
    file.seek(_W64_HEAD_BYTES)
    while len(chunk := file.read(24)) == 24:
        (length,) = struct.unpack("<Q", chunk[16:])
        begins = file.tell() - 24
        if chunk[:4] == b"data":
            unknown = length in (24, *_UNKNOWN_64)
            return {16: struct.pack("<Q", size), begins + 16: struct.pack("<Q", size - begins)} if unknown else {}
        if length < 24:
            return {}
        file.seek(begins + (length + 7) // 8 * 8)
    return {}


_UNKNOWN_64, _W64_HEAD_BYTES = (0, (1 << 63) - 1, (1 << 64) - 1), 40
_UNKNOWN_LENGTH = {
    b".snd": _patches_of_au, b"caff": _patches_of_caf, b"RF64": _patches_of_rf64, b"riff": _patches_of_w64,
    b"fLaC": _patches_of_flac,
}  # fmt: skip
"""By the first bytes of a file, what gives the lengths that its writer did not know, by their places."""


@contextmanager
def without_remarks(path: Path) -> Iterator[None]:
    """Keep what the decoder of MP3 writes about a file off standard error, which has one line for a refusal.

    Files of other formats, recognised by their first bytes, are read as before. Raises OSError.
    """
    with path.open("rb") as file:
        if file.read(4) in _KNOWN:
            yield
            return
    with _QUIET, Path(os.devnull).open("wb") as nowhere:
        before = os.dup(2)
        try:
            os.dup2(nowhere.fileno(), 2)
            yield
        finally:
            os.dup2(before, 2)
            os.close(before)


def require_whole(path: Path) -> None:
    """Raise BadInput, without the file's name, where a WAV (RF64 and W64, too), AIFF, AU or CAF states more bytes than
    are there, and for an Ogg or FLAC file of several streams.

    The library that reads the samples takes such a file for a shorter one, and says nothing. Raises OSError.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
        if head[:4] not in _KNOWN:
            require_whole_mpeg(mpeg_runs(path))
        if name := {b"OggS": "Ogg", b"fLaC": "FLAC"}.get(head[:4]):
            kinds = re.findall(rb"OggS\0(.)|fLaC[\0\x80]\0\0\x22", path.read_bytes(), re.DOTALL)
            begins = sum(name == "FLAC" or kind[0] & _OGG_BEGINS > 0 for kind in kinds)
            if begins > 1:
                raise BadInput(f"{begins} {name} streams in one file", "a single one, which is all that is read")
        if len(head) == _HEAD_BYTES and head[:4] in _STATED:
            end = _STATED[head[:4]](file, head)
            _require(end, size)
            _require_no_samples_behind(file, end, size, _CHUNKS.get(head[:4]))
        if len(head) < _RIFF_BYTES or head[:4] not in _FORMS:
            return
        file.seek(_RIFF_BYTES)
        order, wanted = _FORMS[head[:4]]
        (stated,) = struct.unpack(f"{order}I", head[4:8])
        if not _is_streamed(stated):
            _require(stated + 8, size)
        end = _end_of_samples(file, order, wanted, size)
        _require(end, size)
        _require_no_samples_behind(file, end + end % 2, size, f"{order}4sI")


def forget_time(path: Path) -> None:
    """Set the time of writing, which libsndfile puts beside the peaks of a WAV of floats, to zero.

    The same samples then give the same bytes.
    """
    with path.open("r+b") as file:
        at = file.read(1024).find(b"PEAK")
        if at >= 0:
            file.seek(at + 12)
            file.write(bytes(4))


def _end_of_samples(file: BinaryIO, order: str, wanted: bytes, size: int) -> int:
    """Return where the chunk of samples ends by its own statement; 0 if it does not say, or is missing."""
    while len(chunk := file.read(8)) == 8:
        (length,) = struct.unpack(f"{order}I", chunk[4:])
        if chunk[:4] == wanted:
            return 0 if _is_streamed(length) else file.tell() + length
        if file.tell() + length > size:
            return 0
        file.seek(length + length % 2, 1)
    return 0


def _require_no_samples_behind(file: BinaryIO, end: int, size: int, chunk: str | None) -> None:
    """Raise BadInput where behind the samples, which end there, something lies that is neither zeros nor a chunk.

    No reader can distinguish it from samples that the head does not count. chunk: how a chunk's head is written, None
    for a format without any.
    """
    at = end or size
    while chunk and at + struct.calcsize(chunk) <= size:
        file.seek(at)
        name, length = struct.unpack(chunk, file.read(struct.calcsize(chunk)))
        if name in _SECOND:
            raise BadInput(
                f"a second {name.decode()} at byte {at} of {size}, behind the samples", "one sound in a file"
            )
        if not (name.isascii() and name.decode("latin-1").isprintable() and 0 <= length <= size - at):
            break
        at += struct.calcsize(chunk) + length + length % 2
    file.seek(min(at, size))
    if size - at >= _FEW_BYTES and (rest := file.read()).strip(b"\0"):
        got = f"its head ends the samples at byte {end} of {size}, and {len(rest)} bytes that are no chunk lie behind"
        raise BadInput(got, "a file whose sizes hold, as `ffmpeg` or `sox` write it anew")


_SECOND, _FEW_BYTES = (b"RIFF", b"RIFX", b"RF64", b"FORM", b"data", b"SSND"), 1024
_CHUNKS = {b"RF64": "<4sI", b"caff": ">4sq"}


def _end_of_au(file: BinaryIO, head: bytes) -> int:
    start, length = struct.unpack(f"{'>' if head[:4] == b'.snd' else '<'}II", head[4:12])
    return 0 if _is_streamed(length) else int(start + length)


def _end_of_rf64(file: BinaryIO, head: bytes) -> int:
    stated = int(struct.unpack("<Q", head[28:36])[0])
    if head[12:16] != b"ds64" or stated in _UNKNOWN_64:
        return 0
    file.seek(_RIFF_BYTES)
    while len(chunk := file.read(8)) == 8:
        if chunk[:4] == b"data":
            return file.tell() + stated
        file.seek(struct.unpack("<I", chunk[4:])[0], 1)
    return 0


def _end_of_w64(file: BinaryIO, head: bytes) -> int:
    stated = int(struct.unpack("<Q", head[16:24])[0])
    return 0 if stated in _UNKNOWN_64 else stated


def _end_of_caf(file: BinaryIO, head: bytes) -> int:
    file.seek(8)
    while len(chunk := file.read(12)) == 12:
        (length,) = struct.unpack(">q", chunk[4:])
        if chunk[:4] == b"data" or length < 0:
            return max(0, file.tell() + length) if length >= 0 else 0
        file.seek(min(length, 1 << 62), 1)
    return 0


_STATED = {
    b".snd": _end_of_au, b"dns.": _end_of_au, b"RF64": _end_of_rf64, b"riff": _end_of_w64, b"caff": _end_of_caf,
}  # fmt: skip
"""By the first bytes of a file, what finds its end."""


def _require(stated: int, size: int) -> None:
    if stated > size + 1:  # some writers leave the last pad byte out
        raise BadInput(f"truncated, {size} of {stated} bytes are there", "a whole file")

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

_STREAMED = 0x7FFF0000
"""Lengths from here on, and 0, are written by a program that did not know the length: ffmpeg, sox, arecord."""
_HEAD_BYTES, _RIFF_BYTES, _OGG_BEGINS = 36, 12, 2
_FORMS = {b"RIFF": ("<", b"data"), b"RIFX": (">", b"data"), b"FORM": (">", b"SSND")}
_KNOWN = (b"RIFF", b"RIFX", b"RF64", b"FORM", b"fLaC", b"OggS", b"caff", b".snd", b"riff")
_QUIET = threading.RLock()
_TIMES_LONGER, _TAG_BYTES = 64, 128
_INDEXES = (b"Xing", b"Info", b"VBRI")
_FIRST_FRAME_BYTES, _PIECE_BYTES, _FEW_FRAMES = 1 << 12, 1 << 16, 8
_STATES_FRAMES, _STATES_BYTES, _MONO = 1, 2, 3
UNKNOWN_FRAMES = 1 << 62
"""Frames from which on a length is none: a FLAC of a stream states 0."""


def _is_streamed(length: int) -> bool:
    return length == 0 or length >= _STREAMED


class _ReadThrough(io.FileIO):
    """A file with another head. patches: bytes of it by their place. size: stated for its own."""

    def __init__(self, path: Path, patches: Mapping[int, bytes], size: int) -> None:
        super().__init__(path)
        self._patches, self._size, self._real = patches, size, path.stat().st_size

    def readinto(self, buffer: Any, /) -> int:
        at, view = self.tell(), memoryview(buffer).cast("B")
        if at >= max(self._real, self._size - _TAG_BYTES):  # MPEG's decoder looks for a tag at the end first
            view[:] = bytes(len(view))
            super().seek(at + len(view))
            return len(view)
        count = super().readinto(view) or 0
        for place, content in self._patches.items():
            for k, byte in enumerate(content):
                if at <= place + k < at + count:
                    view[place + k - at] = byte
        return count

    def seek(self, offset: int, whence: int = 0, /) -> int:
        if whence == os.SEEK_END:
            return super().seek(self._size + offset)
        return super().seek(offset, whence)


class _Forward(soundfile.SoundFile):  # type: ignore[misc]  # the library has no types
    """A sound file read from its beginning on: without a length, the library fails to seek where it is at its end."""

    def seekable(self) -> bool:
        return bool(self.frames < UNKNOWN_FRAMES)


def _first_frame(file: BinaryIO, head: bytes) -> tuple[int, bytes]:
    """Return where the frames of an MP3 begin, behind its tag, and the first of them."""
    begins = 0
    if head[:3] == b"ID3":
        begins = 10 + sum((byte & 127) << 7 * (3 - k) for k, byte in enumerate(head[6:10]))
    file.seek(begins)
    return begins, file.read(_FIRST_FRAME_BYTES)


def _patches_of_joined(path: Path) -> dict[int, bytes]:
    """Return what hides the index of an MP3 behind whose last frame by that index others follow, of a second file."""
    with path.open("rb") as file:
        begins, first = _first_frame(file, file.read(_HEAD_BYTES))
        found = re.search(rb"(?:Xing|Info)...(.)(.{8})", first, re.DOTALL)
        if found is None or not found[1][0] & _STATES_BYTES:
            return {}
        at = 4 * (found[1][0] & _STATES_FRAMES)
        file.seek(begins + int.from_bytes(found[2][at : at + 4], "big"))
        rest = file.read(_PIECE_BYTES)
    other = re.search(rb"(\xff[\xe2-\xff]..)(?:.{9}|.{17}|.{32})(?:Xing|Info)", rest, re.DOTALL)
    if other and _kind_of_frame(other[1]) != _kind_of_frame(first):
        raise BadInput("joined MP3 files of two rates, or of mono and stereo", "one file, as `ffmpeg` joins them")
    return {begins + found.start(): bytes(4)} if other or rest.count(first[:2]) >= _FEW_FRAMES else {}


def _kind_of_frame(head: bytes) -> tuple[int, int, bool]:
    """Return version, rate and whether it is mono, of a frame of MPEG sound."""
    return head[1] & 0xFE, head[2] & 0x0C, head[3] >> 6 == _MONO


def is_indexed(path: Path) -> bool:
    """Return whether the length that the library gives is the file's own: an MP3 without an index is estimated."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
        if head[:4] in _KNOWN:
            return True
        _, first = _first_frame(file, head)
    if any(index in first for index in _INDEXES):
        return not _patches_of_joined(path)
    if head[:3] == b"ID3" or head[:1] == b"\xff":
        return False
    with without_remarks(path):  # a recording of a broadcast begins anywhere
        return bool(soundfile.info(str(path)).format != "MP3")


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
        return _ReadThrough(
            path, _patches_of_joined(path), _TIMES_LONGER * size + _TAG_BYTES
        )  # the estimate goes by the first frames
    with path.open("rb") as file:
        head = file.read(_RIFF_BYTES)
        if head[:4] in (b"RIFF", b"RIFX"):
            order, wanted = _FORMS[head[:4]]
            while len(chunk := file.read(8)) == 8:
                (length,) = struct.unpack(f"{order}I", chunk[4:])
                begins = file.tell()
                if chunk[:4] == wanted and _is_streamed(length) and not 0 < length <= size - begins:
                    real = struct.pack(f"{order}I", min(size - begins, 0xFFFFFFFE))
                    return _ReadThrough(path, {4: struct.pack(f"{order}I", size - 8), begins - 4: real}, size)
                if chunk[:4] == wanted:
                    break
                file.seek(length + length % 2, 1)
        elif head[:4] in _UNKNOWN_LENGTH and (patches := _UNKNOWN_LENGTH[head[:4]](file, size)):
            return _ReadThrough(path, patches, size)
    return path


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
            _patches_of_joined(path)
        if name := {b"OggS": "Ogg", b"fLaC": "FLAC"}.get(head[:4]):
            kinds = re.findall(rb"OggS\0(.)|fLaC[\0\x80]\0\0\x22", path.read_bytes(), re.DOTALL)
            begins = sum(name == "FLAC" or kind[0] & _OGG_BEGINS > 0 for kind in kinds)
            if begins > 1:
                raise BadInput(f"{begins} {name} streams in one file", "a single one, which is all that is read")
        if len(head) == _HEAD_BYTES and head[:4] in _STATED:
            _require(_STATED[head[:4]](file, head), size)
        if len(head) < _RIFF_BYTES or head[:4] not in _FORMS:
            return
        file.seek(_RIFF_BYTES)
        order, wanted = _FORMS[head[:4]]
        (stated,) = struct.unpack(f"{order}I", head[4:8])
        if not _is_streamed(stated):
            _require(stated + 8, size)
        _require(_end_of_samples(file, order, wanted, size), size)


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


def _end_of_au(file: BinaryIO, head: bytes) -> int:
    start, length = struct.unpack(f"{'>' if head[:4] == b'.snd' else '<'}II", head[4:12])
    return 0 if _is_streamed(length) else int(start + length)


def _end_of_rf64(file: BinaryIO, head: bytes) -> int:
    stated = int(struct.unpack("<Q", head[20:28])[0])
    return stated + 8 if head[12:16] == b"ds64" and stated not in _UNKNOWN_64 else 0


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

"""How much sound the bytes of an MP3, FLAC or Ogg file hold by their own frames and pages, whatever its head states."""

from __future__ import annotations

import itertools
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from tactuator.errors import BadInput

LARGEST_BYTES = 512 << 20
"""Size of a file whose frames are looked through: a day of speech."""
_KBPS = {
    (1, 1): (32, 64, 96, 128, 160, 192, 224, 256, 288, 320, 352, 384, 416, 448),
    (1, 2): (32, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256, 320, 384),
    (1, 3): (32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256, 320),
    (2, 1): (32, 48, 56, 64, 80, 96, 112, 128, 144, 160, 176, 192, 224, 256),
    (2, 2): (8, 16, 24, 32, 40, 48, 56, 64, 80, 96, 112, 128, 144, 160),
    (2, 3): (8, 16, 24, 32, 40, 48, 56, 64, 80, 96, 112, 128, 144, 160),
}
"""By version (2 for 2.5, too) and layer, ISO/IEC 11172-3 and 13818-3."""
_RATES = {3: (44_100, 48_000, 32_000), 2: (22_050, 24_000, 16_000), 0: (11_025, 12_000, 8000)}
_MONO, _SPARE_FRAMES, _FEWEST_FRAMES = 3, 2, 3
_TAIL_BYTES = 1 << 19
"""Of a FLAC, in which its last frames are sought: the longest has 65,535 samples."""


class _Frame(NamedTuple):
    """The head of a frame of MPEG sound. kind: what all frames of a file share."""

    length: int
    samples: int
    kind: tuple[int, int, int, bool]


@dataclass(frozen=True)
class Run:
    """Frames of an MP3 with nothing between them.

    begin, end: bytes of the frames of sound; frames, samples: of them; index_bytes: of a frame before them that is an
    index; stated: frames of sound that it states (0: none).
    """

    begin: int
    end: int
    frames: int
    samples: int
    kind: tuple[int, int, int, bool]
    index_bytes: int
    stated: int

    @property
    def rate_hz(self) -> int:
        """Return the sampling rate."""
        return self.kind[2]


@lru_cache(maxsize=1024)
def _frame(head: bytes) -> _Frame | None:
    """Return what four bytes say as the head of a frame; None for others, and for one of free bit rate."""
    if len(head) < 4 or head[0] != 0xFF or head[1] < 0xE0:
        return None
    version, layer, index = head[1] >> 3 & 3, 4 - (head[1] >> 1 & 3), head[2] >> 4
    if version == 1 or layer == 4 or index in (0, 15) or head[2] >> 2 & 3 == 3:
        return None
    rate, generation = _RATES[version][head[2] >> 2 & 3], 1 if version == 3 else 2
    samples = 384 if layer == 1 else 576 if layer == 3 and generation == 2 else 1152
    slot = 4 if layer == 1 else 1
    length = samples // 8 // slot * _KBPS[generation, layer][index - 1] * 1000 // rate + (head[2] >> 1 & 1)
    return _Frame(length * slot, samples, (version, layer, rate, head[3] >> 6 == _MONO))


@lru_cache(maxsize=4)
def _runs(path: Path, *state: int) -> tuple[Run, ...]:
    content = path.read_bytes()
    runs, at = list[Run](), 0
    while (at := content.find(b"\xff", at)) >= 0:
        first = _frame(content[at : at + 4])
        following = first and _frame(content[at + first.length : at + first.length + 4])
        if first is None or following is None or following.kind != first.kind:
            at += 1
            continue
        is_index, stated = _index_of(content[at : at + first.length])
        index_bytes, frames = first.length if is_index else 0, -int(is_index)
        begin = at + index_bytes
        while (each := _frame(content[at : at + 4])) and each.kind == first.kind and at + each.length <= len(content):
            at, frames = at + each.length, frames + 1
        if frames >= _FEWEST_FRAMES:
            runs.append(Run(begin, at, frames, frames * first.samples, first.kind, index_bytes, stated))
    return tuple(runs)


def mpeg_runs(path: Path) -> tuple[Run, ...]:
    """Return the runs of frames of an MP3; none for another file, one of free bit rate, or one over half a gigabyte."""
    state = path.stat()
    return _runs(path, state.st_size, state.st_mtime_ns) if state.st_size <= LARGEST_BYTES else ()


def _index_of(content: bytes) -> tuple[bool, int]:
    """Return whether a first frame of MPEG sound is an index of the others, and how many it states (0: it does not)."""
    found = re.search(rb"(?:Xing|Info)...(.)(.{4})|VBRI.{10}(.{4})", content[:200], re.DOTALL)
    if found is None:
        return False, 0
    stated = found[3] or (found[2] if found[1][0] & 1 else bytes(4))
    return True, int.from_bytes(stated, "big")


def has_true_index(runs: tuple[Run, ...], begins: int) -> bool:
    """Return whether an MP3 is what its index says, or less: nothing else lies in it. begins: where its frames do."""
    first = runs[0]
    whole = len(runs) == 1 and first.begin - first.index_bytes == begins
    return whole and first.index_bytes > 0 and first.frames <= first.stated + _SPARE_FRAMES


def mpeg_remarks(runs: tuple[Run, ...]) -> Iterator[str]:
    """Yield what of an MP3 is not as its index says, and where it was passed over."""
    if not runs:
        return
    first, time_s = runs[0], 0.0
    if first.index_bytes and first.stated and first.frames > first.stated + _SPARE_FRAMES:
        frame_s = first.samples / first.frames / first.rate_hz
        yield f"its index states {first.stated * frame_s:.2f} s, {first.frames * frame_s:.2f} s follow: all is read"
    for run, following in itertools.pairwise(runs):
        time_s += run.samples / run.rate_hz
        if (between := following.begin - following.index_bytes - run.end) > 0:
            yield f"{between} bytes at {time_s:.2f} s are no sound: passed over"


def require_whole_mpeg(runs: tuple[Run, ...]) -> None:
    """Raise BadInput for an MP3 that ends before its index says, and for joined files of two rates or of mono and
    stereo.
    """
    for run in runs:
        if run.kind != runs[0].kind:
            raise BadInput(
                f"joined MP3 files of two rates, or of mono and stereo: the second begins at byte {run.begin}",
                "one file, as `ffmpeg` joins them",
            )
    held, stated = sum(run.frames for run in runs), sum(run.stated for run in runs)
    if held < stated - _SPARE_FRAMES:
        raise BadInput(f"truncated, {held} of {stated} frames of an MP3 are there", "a whole file")


def flac_frames(path: Path) -> tuple[int, int, int]:
    """Return where a FLAC file states its number of samples, that number (0: unknown) and how many it holds by its last
    frames (0: they do not show it).
    """
    with path.open("rb") as file:
        head = file.read(1 << 16)
        file.seek(max(0, path.stat().st_size - _TAIL_BYTES))
        tail = file.read()
    at = head.find(b"fLaC")
    if at < 0 or len(head) < at + 26:
        return 0, 0, 0
    block = int.from_bytes(head[at + 8 : at + 10], "big")
    stated = int.from_bytes(head[at + 21 : at + 26], "big") & ((1 << 36) - 1)
    spans = list(_flac_spans(tail, block))
    for (begin, count), (later, more) in reversed(list(itertools.pairwise(spans))):
        if begin + count == later:  # a chance likeness of a frame has no other behind it
            return at + 21, stated, later + more
    return at + 21, stated, 0


def _flac_spans(tail: bytes, block: int) -> Iterator[tuple[int, int]]:
    """Yield the first sample and the number of samples of what is the head of a FLAC frame by its check sum."""
    for found in re.finditer(rb"\xff[\xf8\xf9][\x10-\xfe]", tail):
        at = found.start()
        if at + 17 > len(tail):
            return
        size, rate, leading = tail[at + 2] >> 4, tail[at + 2] & 15, tail[at + 4]
        ones = 8 - (~leading & 0xFF).bit_length()  # of UTF-8, which the number of a frame or sample is written in
        if ones in (1, 8):
            continue
        end = at + 4 + max(ones, 1)
        number = leading & (0x7F >> ones)
        for byte in tail[at + 5 : end]:
            number = number << 6 | byte & 0x3F
        count = 192 if size == 1 else 576 << size - 2 if size < 6 else 256 << max(size - 8, 0)
        if size in (6, 7):
            count = int.from_bytes(tail[end : end + size - 5], "big") + 1
            end += size - 5
        end += {12: 1, 13: 2, 14: 2}.get(rate, 0)
        if rate < 15 and _crc8(tail[at:end]) == tail[end]:
            yield (number if found[0][1] & 1 else number * block), count


def _crc8(content: bytes) -> int:
    value = 0
    for byte in content:
        value ^= byte
        for _ in range(8):
            value = (value << 1 ^ 0x07) & 0xFF if value & 0x80 else value << 1
    return value


def require_whole_ogg(path: Path) -> bool:
    """Raise BadInput for an Ogg file with a page cut off or missing, or times that go back; return whether its last
    page says that it is the last.
    """
    size, at, before, time, ended = path.stat().st_size, 0, None, 0, True
    content = path.read_bytes() if size <= LARGEST_BYTES else b""
    while (at := content.find(b"OggS\0", at)) >= 0:
        head = content[at : at + 27]
        table = content[at + 27 : at + 27 + head[26]] if len(head) == 27 else b""
        if len(head) < 27 or len(table) < head[26] or at + 27 + len(table) + sum(table) > size:
            raise BadInput(f"truncated within the Ogg page at byte {at} of {size}", "a whole file")
        granule, number = struct.unpack("<q", head[6:14])[0], struct.unpack("<I", head[18:22])[0]
        if before is not None and number != before + 1:
            raise BadInput(f"Ogg page {before + 1} is missing at byte {at} of {size}", "a whole file")
        if 0 <= granule < time:
            got = f"the Ogg page at byte {at} states {granule} samples, one before it {time}"
            raise BadInput(got, "times that ascend")
        before, time, ended = number, max(time, granule), bool(head[5] & 4)
        if ended and content.find(b"OggS\0", at + 27 + len(table) + sum(table)) >= 0:
            raise BadInput(f"the Ogg page at byte {at} of {size} is marked as the last, and is not", "a whole file")
        at += 27 + len(table) + sum(table)
    return ended

"""A recorder of Lab Streaming Layer, as others in the room run one: `python -m tests.experiment.session.recorder FILE
SOURCE`.

It finds the streams whose source's id begins so, and writes an XDF file when its input is closed.
"""

import select
import struct
import sys
from pathlib import Path

import pylsl


def chunk(tag: int, content: bytes) -> bytes:
    return struct.pack("<BIH", 4, len(content) + 2, tag) + content


def samples(number: int, rows: list, stamps: list) -> bytes:
    parts = []
    for row, stamp in zip(rows, stamps, strict=True):
        parts.append(struct.pack("<Bd", 8, stamp))
        for value in row:
            text = value.encode() if isinstance(value, str) else None
            parts.append(struct.pack("<d", value) if text is None else struct.pack("<BI", 4, len(text)) + text)
    return chunk(3, struct.pack("<IBI", number, 4, len(rows)) + b"".join(parts))


def main() -> None:
    """Record until the input is closed, and then what is still under way."""
    path, source = sys.argv[1:]
    wanted = (f"name='tactuator-{name}' and starts-with(source_id, '{source}')" for name in ("markers", "levels"))
    inlets = [pylsl.StreamInlet(pylsl.resolve_bypred(each, 1, 60.0)[0]) for each in wanted]
    for inlet in inlets:
        inlet.open_stream(60.0)
    taken: list[tuple[list, list]] = [([], []) for _ in inlets]
    goes_on = True
    while goes_on:
        goes_on = not select.select([sys.stdin], [], [], 0.0)[0]
        for inlet, (rows, stamps) in zip(inlets, taken, strict=True):
            more, at = inlet.pull_chunk(0.5 if not goes_on else 0.05, 4096)
            rows.extend(more)
            stamps.extend(at)
    with Path(path).open("wb") as file:
        file.write(b"XDF:" + chunk(1, b'<?xml version="1.0"?><info><version>1.0</version></info>'))
        for number, (inlet, (rows, stamps)) in enumerate(zip(inlets, taken, strict=True), 1):
            file.write(chunk(2, struct.pack("<I", number) + inlet.info(5.0).as_xml().encode()))
            file.write(samples(number, rows, stamps))


if __name__ == "__main__":
    main()

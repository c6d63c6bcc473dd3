"""A recorder of Lab Streaming Layer, as others in the room run one: `python -m tests.experiment.session.recorder FILE
SOURCE`.

It finds the streams whose source's id begins so, and writes what they told when its input is closed.
"""

import json
import select
import sys
from pathlib import Path

import pylsl


def main() -> None:
    """Record until the input is closed, and then what is still under way."""
    path, source = sys.argv[1:]
    wanted = (f"name='tactuator-{name}' and starts-with(source_id, '{source}')" for name in ("markers", "levels"))
    inlets = [pylsl.StreamInlet(pylsl.resolve_bypred(each, 1, 60.0)[0]) for each in wanted]
    for inlet in inlets:
        inlet.open_stream(60.0)
    streams = [{"rows": [], "stamps": [], "about": inlet.info(5.0).as_xml()} for inlet in inlets]
    goes_on = True
    while goes_on:
        goes_on = not select.select([sys.stdin], [], [], 0.0)[0]
        for inlet, stream in zip(inlets, streams, strict=True):
            rows, stamps = inlet.pull_chunk(0.05 if goes_on else 0.5, 4096)
            stream["rows"].extend(rows)
            stream["stamps"].extend(stamps)
    Path(path).write_text(json.dumps(streams))


if __name__ == "__main__":
    main()

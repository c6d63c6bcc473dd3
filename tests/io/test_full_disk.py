"""Every writer on a disk without room, or under Ctrl-C: one line, and nothing half-written.

A limit on the length of a file stands for the disk: the system refuses the write in the same way.
"""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tactuator.io import hdf5
from tactuator.io.record import write_record
from tactuator.io.reference import ReferenceHead, write_reference
from tactuator.signals.record import Record

SCRIPT = """
import resource, sys
from pathlib import Path
import numpy as np
from tactuator.model.plant_model import PlantModel
from tactuator.errors import BadInput
from tactuator.experiment.store.store import Store
from tactuator.io.model import write_model
from tactuator.io.record import write_record
from tactuator.io.reference import ReferenceHead, write_reference
from tactuator.io.response import write_responses
from tactuator.signals.record import Record
from tactuator.signals.record import Response

noise = np.random.default_rng(0).standard_normal(40_000)
one = np.ones(2000)
response = Response("index", "free", 20.0, "stepped-sine", np.arange(1.0, 2001.0), one + 0j, one, one, one, one,
                    one > 2, one > 0, one)

def reference(path):
    with write_reference(path, ReferenceHead(4000.0, ("index",))) as writer:
        for start in range(0, 40_000, 4000):
            writer.write(noise[start : start + 4000, None])

writers = {
    "record.h5": lambda path: write_record(path, Record(4000.0, noise, noise, "V", "V")),
    "response.h5": lambda path: write_responses(path, [response]),
    "response.csv": lambda path: write_responses(path, [response]),
    "reference.h5": reference,
    "reference.wav": reference,
    "lab.db": lambda path: Store(path).close(),
    "model.json": lambda path: write_model(
        path, PlantModel(np.ones(1), np.array([1.0, 94.0]), 0.0, np.eye(3), (1.0, 2.0), record={"x": "y" * 60_000})
    ),
}
folder, refused, written = Path(sys.argv[1]), 0, 0
for room in (0, 2048, 9000, 50_000, 150_000, 1 << 30):
    for name, write in writers.items():
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, resource.RLIM_INFINITY))
        try:
            write(folder / name)
            written += 1
        except BadInput as error:
            assert "\\n" not in str(error) and "room" in str(error), error
            assert name == "lab.db" or not list(folder.iterdir()), (name, room, list(folder.iterdir()))
            refused += 1
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        if name == "lab.db":
            write(folder / name)  # its file stays, since another program may have it, and is made once there is room
        for path in folder.iterdir():
            path.unlink()
sys.stderr.write(f"{refused} refused, {written} written")
"""


def test_writers__six_levels_of_room__written_whole_or_refused_in_a_line(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT, str(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    refused, written = (int(part.split()[0]) for part in done.stderr.split(","))
    assert refused + written == 42
    assert refused > 20
    assert written >= 6


SAMPLES = np.sin(np.arange(40_000) / 7.0)


@pytest.fixture
def interrupted(monkeypatch):
    """Ctrl-C within a write that the HDF5 library asks for: as it comes in, before its first line."""
    whole, writes = hdf5._Disk.write, []

    def write(disk, data):
        writes.append(1)
        if len(writes) == 3:
            signal.raise_signal(signal.SIGINT)
        return whole(disk, data)

    monkeypatch.setattr(hdf5._Disk, "write", write)
    return writes


def test_record__ctrl_c_within_a_write__is_not_there(tmp_path: Path, interrupted) -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        write_record(tmp_path / "r.h5", Record(1000.0, SAMPLES, SAMPLES, "V", "V"))
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(signal.SIGINT) is before


def test_reference__ctrl_c_within_a_write__ends_at_the_next_block(tmp_path: Path, interrupted) -> None:
    blocks = 0
    with (
        pytest.raises(KeyboardInterrupt),
        write_reference(tmp_path / "r.h5", ReferenceHead(4000.0, ("index",))) as writer,
    ):
        for _ in range(1000):
            writer.write(SAMPLES[:, None])
            blocks += 1
    assert 0 < blocks < 1000
    assert list(tmp_path.iterdir()) == []

"""Ctrl-C while a file is being written: the file is whole, or it is not there."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest

from tactuator.files.formats import hdf5
from tactuator.files.record import write_record
from tactuator.files.reference import ReferenceHead, write_reference
from tactuator.signals.record import Record

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

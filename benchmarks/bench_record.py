"""Records: a CSV file of a million rows read, beside `numpy.loadtxt`; and the memory of a long one identified.

The long record is the simulated display's motor for 1,000 s at 4 kHz (as many samples as are read of any record), from
our own HDF5; the short one is its first minute. What both cost is that of the whole command in a process of its own.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from timing import in_turn, of_program

from tactuator.io.columns import read_columns
from tactuator.io.record import write_record
from tactuator.model.description import Channel, Display
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.excitation import paper_mix
from tactuator.signals.record import Record
from tactuator.signals.systems import ContinuousSystem

ROWS, RATE_HZ = 1_000_000, 4000.0
MOTOR = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])


def csv(folder: Path) -> dict[str, object]:
    path = folder / "record.csv"
    values = np.random.default_rng(0).standard_normal((ROWS, 2))
    table = np.column_stack([np.arange(ROWS) / RATE_HZ, values])
    np.savetxt(path, table, delimiter=",", fmt="%.8f", header="time_s,command_v,position_v", comments="")
    spent = in_turn({"own": lambda: read_columns(path), "loadtxt": lambda: np.loadtxt(path, delimiter=",", skiprows=1)})
    megabytes = path.stat().st_size / 1e6
    figures: dict[str, object] = {f"{name}_mb_per_s": megabytes / seconds for name, seconds in spent.items()}
    return figures | {"times_loadtxt": spent["loadtxt"] / spent["own"], "goal_times_loadtxt": 400.0 / 336.0}


def identified(folder: Path) -> dict[str, object]:
    channel = Channel("index", 0.19898, 12.5, MOTOR)
    figures: dict[str, object] = {}
    for seconds in (60.0, 1000.0):
        command = paper_mix(seconds, RATE_HZ, 10.0, np.random.default_rng(0), plant=MOTOR, travel_v=2.4)
        trace = SimulatedRig(Display(RATE_HZ, (channel,), 1, "paper"), 3).drive(command[:, None])
        path = folder / "long.h5"
        write_record(path, Record(RATE_HZ, trace.command_v[:, 0], trace.position_v[:, 0]))
        cpu_s, _, peak_mb = of_program([sys.executable, "-m", "tactuator", "identify", str(path), "--json"])
        figures[f"{seconds:g} s"] = {"cpu_s": cpu_s, "peak_mb": peak_mb}
    return figures | {"goal_peak_mb": 1000.0}


def run() -> dict[str, object]:
    with tempfile.TemporaryDirectory() as folder:
        return {"csv": csv(Path(folder)), "identify": identified(Path(folder))}

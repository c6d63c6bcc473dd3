"""The guard against adversaries while a finger is learnt: comfort, travel and 250 ms, on the truth of generator.c.

The board's own interrupt (core/board) runs with generator.c at its converters, tick by tick. The adversaries are those
of tests/rig/guard. Comfort: references far beyond what is allowed, fingers that come and go, a late interrupt, a silent
link, restarts; what is felt, by the inverse of the designed H, stays within 1 dB of 55 dB SL. Travel: images that
misbehave, with a feed-forward by a wrong model, and sensors that fail; 12.5 mm is never reached, and the command is
gone 250 ms after a fault. Seen to fail with --unguarded, where the safety table allows ten times as much.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.model.controller import Controller
from tactuator.runtime._core import ffi, lib
from tests.rig.guard.guarded import Guarded, adaptive
from tests.rig.guard.test_guard_adversary import adversary, misbehaving, signs
from tests.rig.guard.test_guard_adversary import felt as felt_by
from witnesses.touch import felt
from witnesses.touch.device import Device

TRAVEL_MM, LOUDEST_DB_SL = 12.5, 56.0
QUARTER_S = 1000
OPEN, SHORTED, FROZEN, REVERSED = range(1, 5)


@dataclass
class Run:
    """What was moved (mm) and put out (V), each (n, 3), and the tick at which a fault began, from the first."""

    moved_mm: list[list[float]] = field(default_factory=list)
    command_v: list[list[float]] = field(default_factory=list)
    fault_at: int | None = None


class Guard:
    """A board with `controller` (its table of safety with it), and three devices of generator.c."""

    def __init__(self, controller: Controller, seed: int, unguarded: bool, drives: bool) -> None:
        self._guarded = Guarded(controller, drives, seed)
        self.board = self._guarded.board
        self._devices = [Device(felt.example(), p, felt.fixed(p), 3 * seed + p) for p in range(3)]
        self.is_touched = False
        self.faults = [0, 0, 0]
        self._held = [0, 0, 0]
        self.run = Run()
        if unguarded:
            self._loosen()

    def _loosen(self) -> None:
        self.board.safety.fade_ticks = self.board.safety.quick_ticks = 4 * QUARTER_S
        for place in range(3):
            channel = self.board.channel[place]
            channel.safety.reference_max *= 10.0
            channel.guard_table.resting.second *= 10.0

    def _seen(self, place: int, code: int) -> int:
        broken = {OPEN: 32767, SHORTED: 0, FROZEN: self._held[place], REVERSED: -code}
        fault = self.faults[place]
        self._held[place] = code if not fault else self._held[place]
        return min(broken.get(fault, code), 32767)

    def play(self, rows: FloatArray, lateness: int = 0, heard: bool = True) -> None:
        """Let one tick pass for each row (n, 3) of the reference."""
        wants = np.ascontiguousarray(rows, dtype=np.float32)
        put_out, read = ffi.new("int32_t[4]"), ffi.new("int32_t[4]")
        channels = felt.example().channels
        for row in wants:
            lib.tact_board_stream(self.board, self.board.tick, ffi.from_buffer("float[]", row), 1)
            if heard:
                self.board.silence = 0
            if lib.tact_board_waits(self.board):
                continue
            lib.tact_period_latch(self.board, put_out)
            for place, device in enumerate(self._devices):
                read[place] = self._seen(place, device.read())
            self.run.moved_mm.append(
                [d.y_v / c.sensor_gain_v_per_mm for d, c in zip(self._devices, channels, strict=True)]
            )
            self.run.command_v.append([put_out[place] * channels[place].converter.step_v for place in range(3)])
            lib.tact_period_step(self.board, read, lateness)
            for place, device in enumerate(self._devices):
                device.advance(put_out[place], felt.nominal(place) if self.is_touched else ())
            if self.run.fault_at is None and self.board.mode == lib.TACT_FAULT:
                self.run.fault_at = len(self.run.moved_mm)


def comfort(seed: int, unguarded: bool) -> float:
    """Return the loudest that is felt of one adversary, dB SL."""
    rng = np.random.default_rng(seed)
    guard = Guard(adaptive(), seed, unguarded, False)
    stretches = int(rng.integers(2, 5))
    for stretch in range(stretches):
        ends = stretch == stretches - 1
        late, silent = (ends and rng.random() < 0.3 for _ in range(2))
        rows = adversary(rng, int(rng.integers(500, 1800)))
        for piece in np.split(rows, np.sort(rng.integers(0, len(rows), rng.integers(0, 3)))):
            if rng.random() < 0.5:
                guard.is_touched = bool(rng.integers(2))
            guard.play(piece, 100 * late, not silent)
    moved: NDArray[np.float64] = np.array(guard.run.moved_mm)
    loudest = max(float(np.max(np.abs(felt_by(c, adaptive).of(moved[:, c])))) for c in range(3))
    return float(20.0 * np.log10(loudest))


def travel(seed: int, unguarded: bool) -> tuple[float, float]:
    """Return how far one misbehaving image moves, mm, and the command from 250 ms after a fault, V."""
    rng = np.random.default_rng(seed)
    drives = bool(rng.random() < 0.25)
    guard = Guard(adaptive() if drives else misbehaving(rng, adaptive), seed, unguarded, drives)
    guard.is_touched = bool(rng.integers(2))
    when = int(rng.integers(1, 1500))
    loud = rng.uniform(0.1, 10.0) if drives else rng.choice([1.0, 10.0, 300.0, 1e5])
    rows = loud * np.stack([signs(rng, when + 1800, c) for c in range(3)], axis=1)
    guard.play(rows[:when])
    guard.faults = [int(rng.integers(1, 5)) if rng.random() < 0.5 else 0 for _ in range(3)]
    guard.is_touched ^= bool(rng.random() < 0.2)
    guard.play(rows[when:])
    command: NDArray[np.float64] = np.abs(np.array(guard.run.command_v))
    after = command.shape[0] if guard.run.fault_at is None else guard.run.fault_at + QUARTER_S
    return float(np.max(np.abs(guard.run.moved_mm))), float(np.max(command[after:], initial=0.0))


def main() -> int:
    """Print the worst of all adversaries; return 0 where nothing is passed."""
    given = felt.arguments(__doc__, 300, "adversaries of each kind", unguarded="a table that allows more: broken")
    seeds = range(1000 * given.seed, 1000 * given.seed + given.count)
    loudest = max(comfort(seed, given.unguarded) for seed in seeds)
    moved = [travel(seed, given.unguarded) for seed in seeds]
    kept = [
        felt.verdict(f"comfort, {given.count} adversaries: felt at most, dB SL", loudest, LOUDEST_DB_SL),
        felt.verdict(f"travel, {given.count} images: moved at most", max(mm for mm, _ in moved), TRAVEL_MM, "mm"),
        felt.verdict("250 ms after a fault: command at most", max(v for _, v in moved), 1e-3, "V"),
    ]
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())

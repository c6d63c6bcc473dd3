"""Many independent closed loops at once, one SIMD lane each: for Monte Carlo work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import ChannelController
from tactuator.model.description import Channel
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.simulation import SimulatedBlock, block_samples, check_arithmetic, empty_block
from tactuator.runtime.tables import controller_table, display_table
from tactuator.runtime.touch_table import touch_table

KERNELS = {"widest": 0, "single": 1, "baseline": 2, "avx2": 3, "avx512": 4}
"""The core's kernels by name; all give the same bits. "single" is the loop that `Simulation` runs."""


def kernels_available() -> tuple[str, ...]:
    """Return the names of the kernels that this processor can run."""
    return tuple(name for name, number in KERNELS.items() if lib.tact_lanes_available(number))


@dataclass(frozen=True)
class Loop:
    """One channel of a simulated display with its controller, touched or not, with noise of its own."""

    channel: Channel
    controller: ChannelController
    seed: int = 0
    load: str | None = None


@dataclass(frozen=True)
class LoopMetrics:
    """Metrics of each loop, arrays of shape (loops,): mean, rms and peak displacement (mm), rms and peak command (V),
    complex amplitude of the displacement at the probe's frequency (mm; zero without a probe; phase re a sine), samples
    in which something saturated.
    """

    displacement_mean_mm: FloatArray
    displacement_rms_mm: FloatArray
    displacement_peak_mm: FloatArray
    command_rms_v: FloatArray
    command_peak_v: FloatArray
    amplitude_mm: ComplexArray
    saturated: NDArray[np.int64]


class ManyLoops:
    """A number of `loops` side by side at one rate and computing delay. Loop i is, bit for bit, the only channel of a
    `Simulation` of that seed. Loops of the same structure that lie next to each other share vectors, sixteen at a time.
    """

    def __init__(self, loops: Sequence[Loop], rate_hz: float, delay_samples: int, kernel: str = "widest") -> None:
        if not loops:
            raise BadInput("no loop", "one or more")
        if kernel not in kernels_available():
            raise BadInput(f"kernel {kernel!r}; allowed on this processor: {', '.join(kernels_available())}")
        if not 0 <= delay_samples <= lib.TACT_DELAY_MAX:
            raise BadInput(f"delay_samples is {delay_samples}", f"0 to {lib.TACT_DELAY_MAX}")
        self.rate_hz = rate_hz
        self._kernel = KERNELS[kernel]
        self._displays: dict[int, tuple[Any, list[Any], tuple[str | None, ...]]] = {}
        self._controllers: dict[int, Any] = {}
        self._touches: dict[int, Any] = {}
        self._described = tuple(loops)  # keeps the ids above alive
        self._loops = ffi.new("tact_closed_loop[]", len(loops))
        for index, loop in enumerate(loops):
            self._fill(index, loop, delay_samples)

    def __len__(self) -> int:
        return len(self._described)

    def play(self, reference: ArrayLike, force_v: ArrayLike | None = None) -> SimulatedBlock:
        """Play a reference (n, 1), the same for all, or (n, loops), in threshold units; return what came of it, each
        (n, loops).
        """
        samples = self._reference(reference).shape[0]
        block, trace = empty_block(samples, len(self))
        self._run(reference, force_v, trace, ffi.NULL, ffi.NULL)
        return block

    def measure(
        self, reference: ArrayLike, probe_hz: float | None = None, force_v: ArrayLike | None = None
    ) -> LoopMetrics:
        """Play a reference as `play` does and return its metrics, added up on the way: nothing of the size of the
        reference is written.
        """
        samples = self._reference(reference).shape[0]
        sums = ffi.new("tact_metrics[]", len(self))
        probe = ffi.NULL
        if probe_hz is not None:
            angle = 2.0 * np.pi * probe_hz / self.rate_hz * np.arange(samples)
            sine, cosine = np.sin(angle), np.cos(angle)
            probe = ffi.new("tact_probe *")
            probe.sine, probe.cosine = ffi.from_buffer("double[]", sine), ffi.from_buffer("double[]", cosine)
        self._run(reference, force_v, ffi.NULL, sums, probe)
        count = max(samples, 1)

        def column(name: str) -> FloatArray:
            return np.array([getattr(each, name) for each in sums], dtype=np.float64)

        return LoopMetrics(
            displacement_mean_mm=column("displacement_sum") / count,
            displacement_rms_mm=np.sqrt(column("displacement_squares") / count),
            displacement_peak_mm=column("displacement_peak_mm"),
            command_rms_v=np.sqrt(column("command_squares") / count),
            command_peak_v=column("command_peak_v"),
            amplitude_mm=2.0 / count * (column("in_phase") + 1j * column("quadrature")),
            saturated=column("saturated").astype(np.int64),
        )

    def _fill(self, index: int, loop: Loop, delay_samples: int) -> None:
        if not 0 <= loop.seed < 2**32:
            raise BadInput(f"seed is {loop.seed}", f"0 to {2**32 - 1}")
        if id(loop.channel) not in self._displays:
            self._displays[id(loop.channel)] = display_table(loop.channel, self.rate_hz)
        if id(loop.controller) not in self._controllers:
            self._controllers[id(loop.controller)] = controller_table(loop.controller)
            touch = touch_table(loop.controller, self.rate_hz, 0)
            self._touches[id(loop.controller)] = touch if touch.feedback_count else ffi.NULL
        table, plants, loads = self._displays[id(loop.channel)]
        if delay_samples == 0 and any(plant.sensor_direct for plant in plants[0]):
            raise BadInput(f"channel {loop.channel.name!r}: the plant answers at once", "delay_samples 1 or more")
        if loop.load not in loads:
            raise BadInput(
                f"channel {loop.channel.name!r}: load {loop.load!r} is not described",
                f"{', '.join(name or 'none' for name in loads)}",
            )
        into = self._loops[index]
        into.display, into.controller = table, self._controllers[id(loop.controller)]
        into.touch = self._touches[id(loop.controller)]
        into.delay_samples = delay_samples
        lib.tact_display_reset(table, ffi.addressof(into, "display_state"), loop.seed, 0)
        into.display_state.touched = loads.index(loop.load)
        lib.tact_closed_loop_rest(ffi.addressof(self._loops, index))

    def _reference(self, reference: ArrayLike) -> FloatArray:
        array = np.asarray(reference)
        columns = 1 if array.ndim == 1 or array.shape[1:] == (1,) else len(self)
        return block_samples(array, columns, "reference")

    def _run(self, reference: ArrayLike, force_v: ArrayLike | None, trace: Any, sums: Any, probe: Any) -> None:
        check_arithmetic()
        inputs = self._reference(reference)
        forces = ffi.NULL
        if force_v is not None:
            force = block_samples(force_v, len(self), "force")
            if force.shape[0] != inputs.shape[0]:
                raise BadInput(f"force has {force.shape[0]} samples", f"{inputs.shape[0]}, as the reference has")
            forces = ffi.from_buffer("double[]", force)
        lib.tact_lanes_play(
            self._kernel,
            self._loops,
            len(self),
            ffi.from_buffer("double[]", inputs),
            inputs.shape[1],
            forces,
            trace,
            sums,
            probe,
            inputs.shape[0],
        )

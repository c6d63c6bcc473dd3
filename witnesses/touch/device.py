"""The witnesses' own device (generator.c), compiled, around the product's controller (product.c with core/)."""

from __future__ import annotations

import ctypes
import os
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.model.controller import ChannelController
from tactuator.model.description import Channel, Display
from tactuator.runtime._core import ffi
from tactuator.runtime.tables import controller_table

HERE = Path(__file__).resolve().parent
CORE = HERE.parents[1] / "core"
SUBSTEPS, LINES_MAX, DELAY_MAX, DEAD_MAX, STATES = 4, 4, 16, 256, 5
_NUMBER, _COUNT = ctypes.c_double, ctypes.c_int32


class _Finger(ctypes.Structure):
    _fields_ = [
        (name, _NUMBER)
        for name in ("mass", "damping", "stiffness", "second_mass", "second_damping", "second_stiffness")
    ]


class _Device(ctypes.Structure):
    _fields_ = [
        *((n, _NUMBER) for n in ("rate_hz", "gain", "damping", "stiffness", "friction_v", "presliding_v", "noise_v")),
        ("step_v", _NUMBER),
        *((name, _NUMBER * LINES_MAX) for name in ("hum_hz", "hum_v", "hum_phase")),
        *((name, _COUNT) for name in ("code_max", "delay", "dead_substeps", "touching")),
        *((name, ctypes.c_uint64) for name in ("noise", "tick", "substep")),
        ("x", _NUMBER * STATES),
        ("delayed_v", _NUMBER * DELAY_MAX),
        ("dead_v", _NUMBER * DEAD_MAX),
    ]


@cache
def _library() -> Any:
    """Return generator.c and product.c with the core's controller, compiled as the product is."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "witness.so"
        rooms = [path for room in ("arithmetic", "control", "touch") for path in sorted((CORE / room).glob("*.c"))]
        sources = [str(path) for path in (HERE / "generator.c", HERE / "product.c", *rooms)]
        flags = ["-std=gnu99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-shared", "-fPIC", f"-I{CORE}"]
        compiler = os.environ.get("CC", "cc")
        subprocess.run([compiler, *flags, *sources, "-lm", "-o", str(out)], check=True)
        library = ctypes.CDLL(str(out))
    library.product_size.restype = ctypes.c_size_t
    library.product_spoil.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_float]
    return library


@dataclass(frozen=True)
class Played:
    """What was at the finger (the truth in sensor volts), at the motor (volts) and at the A/D (volts), each (n,)."""

    y_v: FloatArray
    command_v: FloatArray
    read_v: FloatArray


def _vector(signal: NDArray[Any], dtype: type = np.float64) -> NDArray[Any]:
    return np.ascontiguousarray(signal, dtype=dtype)


def _at(signal: NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(signal.ctypes.data)


class Device:
    """One channel of `display`, its figures times `plant` (gain, damping, stiffness), with the product's controller.

    own: the channel's controller, at its place on the board. Everything random comes from the seed.
    """

    def __init__(
        self,
        display: Display,
        place: int,
        own: ChannelController,
        seed: int,
        plant: tuple[float, float, float] = (1.0, 1.0, 1.0),
    ) -> None:
        channel = display.channels[place]
        self._state = _device(display, channel, plant, np.random.default_rng(seed))
        self._tables = controller_table(own, display.rate_hz, place)
        self._product = ctypes.create_string_buffer(_library().product_size() + 64)
        self._address = ctypes.c_void_p(-(-ctypes.addressof(self._product) // 64) * 64)
        _library().product_begin(self._address, ctypes.c_void_p(int(ffi.cast("uintptr_t", self._tables[0]))))

    def play(
        self,
        reference: FloatArray,
        fingers: Sequence[Sequence[float]] = (),
        touching: NDArray[np.int32] | None = None,
        force_v: FloatArray | None = None,
    ) -> Played:
        """Play a reference (n,) in threshold units. fingers: mass, damping, stiffness, and those of a second mass.

        touching: which of them touches in each sample, from 1, 0 for none; left out, the first touches throughout.
        """
        n = reference.size
        table = (_Finger * (1 + len(fingers)))(_Finger(), *(_Finger(*finger) for finger in fingers))
        which = np.full(n, min(1, len(fingers)), np.int32) if touching is None else _vector(touching, np.int32)
        asked, force = _vector(reference), _vector(np.zeros(n) if force_v is None else force_v)
        y_v, command_v, read_v = np.empty(n), np.empty(n), np.empty(n)
        _library().device_play(
            ctypes.byref(self._state),
            _library().product_step,
            self._address,
            ctypes.c_size_t(n),
            *(_at(asked), table, _at(which), _at(force), _at(y_v), _at(command_v), _at(read_v)),
        )
        return Played(y_v, command_v, read_v)

    def weights(self) -> tuple[float, float]:
        """Return what the controller has learnt: of the mass, of the damping with the stiffness."""
        found = (_NUMBER * 2)()
        _library().product_weights(self._address, found)
        return found[0], found[1]

    @property
    def y_v(self) -> float:
        """Return where the finger is now, sensor volts."""
        return float(self._state.x[0])

    def read(self) -> int:
        """Return the code that the A/D reads now."""
        return int(_library().device_read(ctypes.byref(self._state)))

    def advance(self, code: int, finger: Sequence[float]) -> None:
        """Go on by one sample with a code at the D/A, under a finger or none (an empty one)."""
        fingers = (_Finger * 2)(_Finger(), _Finger(*finger))
        _library().device_advance(ctypes.byref(self._state), code, fingers, int(bool(finger)))

    def spoil(self, at: int, value: float) -> bool:
        """Put `value` in place of one of the estimator's numbers; tell whether there is one at that place."""
        return bool(_library().product_spoil(self._address, at, value))


def _device(display: Display, channel: Channel, plant: tuple[float, float, float], rng: np.random.Generator) -> _Device:
    environment, converter = channel.environment, channel.converter
    figures = (channel.plant.gain, -np.sum(channel.plant.poles).real, np.prod(channel.plant.poles).real)
    dead = channel.plant.delay_s * display.rate_hz * SUBSTEPS
    assert abs(dead - round(dead)) < 1e-6, "a dead time of whole substeps"
    assert (converter.polarity, converter.offset_v) == (1, 0.0), "a converter without offset"
    state = _Device()
    state.rate_hz = display.rate_hz
    state.gain, state.damping, state.stiffness = (one * by for one, by in zip(figures, plant, strict=True))
    state.friction_v, state.presliding_v = environment.friction_v, environment.presliding_v
    state.noise_v, state.step_v = environment.noise_v_rms, converter.step_v
    for i, (line_hz, peak_v) in enumerate(zip(environment.hum_hz, environment.hum_v_peak, strict=True)):
        state.hum_hz[i], state.hum_v[i], state.hum_phase[i] = line_hz, peak_v, rng.uniform(0.0, 2.0 * np.pi)
    state.code_max, state.delay, state.dead_substeps = 2 ** (converter.bits - 1) - 1, display.delay_samples, round(dead)
    state.noise = int(rng.integers(1, 2**63))
    return state

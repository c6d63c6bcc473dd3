"""A rig whose display is the equations of motion by Runge and Kutta, with Coulomb-like friction, hum and noise: no line
of the simulated display. What touches it is a chain of two, or one mass, damper and spring."""

import numpy as np
from numpy.typing import NDArray

from tactuator.model.controller import Controller
from tactuator.rig.rig import Rig, Trace
from tests.measure.loops import RATE_HZ

GAIN, DAMPING, STIFFNESS = 2875.0, 94.0, 290.0
FRICTION_V, PRESLIDING_V = 4e-3, 10e-3

Figures = tuple[float, ...]


class EquationsRig(Rig):
    """One channel in closed loop; `touching`: (mass, damping, stiffness), or six figures of a chain."""

    rate_hz = RATE_HZ
    channels = ("index",)
    drive = stream = None
    _fingers = ()

    def __init__(self, seed: int) -> None:
        self.touching: Figures = (0.0, 0.0, 0.0)
        self._rng = np.random.default_rng(seed)
        self._made: Controller | None = None

    def load(self, controller: Controller) -> None:
        self._made = controller

    def rest(self) -> None:
        """At rest each block begins anyway."""

    def play(self, reference: NDArray[np.float64]) -> Trace:
        assert self._made is not None
        own = self._made.channels[0]
        asked = self._prefiltered(own.prefilter_sos, reference[:, 0])
        time = np.arange(asked.size) / RATE_HZ
        error = 0.2e-3 * self._rng.standard_normal(asked.size)
        for hertz, volts in ((60.0, 1e-3), (120.0, 0.3e-3), (180.0, 0.2e-3)):
            error += volts * np.sin(2.0 * np.pi * hertz * time + self._rng.uniform(0.0, 6.0))
        command, position = self._run(np.asarray(own.feedback_sos).tolist(), asked.tolist(), error.tolist())
        columns = [np.array(one)[:, None] for one in (command, position)]
        return Trace(RATE_HZ, self.channels, reference, *columns, np.zeros((asked.size, 1), dtype=bool))

    @staticmethod
    def _prefiltered(sections: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
        from scipy.signal import sosfilt

        return np.asarray(sosfilt(sections, values))

    def _run(
        self, sections: list[list[float]], asked: list[float], error: list[float]
    ) -> tuple[list[float], list[float]]:
        m, b, k, *behind = self.touching
        m2, b2, k2 = behind or (0.0, 0.0, 0.0)
        h, stiff = 1.0 / RATE_HZ, FRICTION_V / PRESLIDING_V

        def rate(x: float, v: float, x2: float, v2: float, f: float, u: float) -> tuple[float, ...]:
            push = GAIN * (u - f) - DAMPING * v - STIFFNESS * x
            rubbed = stiff * (1.0 - (f if v > 0.0 else -f) / FRICTION_V) * v
            if not m2:
                return v, (push - b * v - k * x) / (1.0 + m), 0.0, 0.0, rubbed
            link = b * (v - v2) + k * (x - x2)
            return v, (push - link) / (1.0 + m), v2, (link - b2 * v2 - k2 * x2) / m2, rubbed

        state = (0.0, 0.0, 0.0, 0.0, 0.0)
        past = [[0.0, 0.0] for _ in sections]
        late, command, position = 0.0, [], []
        for wanted, wrong in zip(asked, error, strict=True):
            read = round((state[0] + wrong) * 3276.8) / 3276.8
            value = wanted - read
            for section, kept in zip(sections, past, strict=True):
                out = section[0] * value + kept[0]
                kept[0] = section[1] * value - section[4] * out + kept[1]
                kept[1] = section[2] * value - section[5] * out
                value = out
            command.append(late)
            position.append(read)
            one = rate(*state, late)
            half = rate(*(a + 0.5 * h * r for a, r in zip(state, one, strict=True)), late)
            again = rate(*(a + 0.5 * h * r for a, r in zip(state, half, strict=True)), late)
            last = rate(*(a + h * r for a, r in zip(state, again, strict=True)), late)
            state = tuple(
                a + h / 6.0 * (p + 2.0 * q + 2.0 * r + s)
                for a, p, q, r, s in zip(state, one, half, again, last, strict=True)
            )
            late = max(-10.0, min(10.0, value))
        return command, position

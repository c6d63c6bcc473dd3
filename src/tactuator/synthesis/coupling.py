"""Coupled loops: whether they are stable together, and what of one finger's motion the others feel.

With the plants P, the controllers C and F of the channels (diagonal) and the shares K (zero on the diagonal) the motion
is y = P (I + K) u and the command u = C (F r - y). Since det(I + P (I + K) C) = det(I + P C) det(I + K T), loops that
are stable each by itself are stable together

- if the greatest singular value of |K| T stays below one at every frequency (small gain), and
- otherwise exactly if det(I + K T) does not turn around zero from frequency zero to half the rate and back (the
  generalised Nyquist criterion; Skogestad & Postlethwaite 2005, Multivariable Feedback Control, section 4.9).

Beyond the frequencies of a measured coupling its last values are held.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.controller import Controller
from tactuator.model.coupling import RADIUS, Coupling, smooth_shares
from tactuator.model.description import Display
from tactuator.model.verdict import Finding, Outcome, compared
from tactuator.signals.decibels import from_db
from tactuator.signals.discretise import zero_order_hold
from tactuator.signals.loop import TwoDegreeLoop, analysis_grid_hz
from tactuator.synthesis.family import UNLOADED, Member, plant_family
from tactuator.synthesis.felt import beside_friction, felt_db_sl

CROSSTALK, TOGETHER = "felt crosstalk", "coupled loops, small gain"
_POINTS, _ROUNDS = 600, 6
_STEP_RAD = 1.0
"""Greatest turn of the determinant between two frequencies, beyond which the grid is too coarse to count its turns."""
_REMEDY = "a stiffer or heavier frame, fingers on frames of their own, or a lower comfort_db_sl"


def shares_at(display: Display, frequency_hz: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """Return the shares K of a display's coupling at frequencies (m,), and their standard deviation, (m, out, in)."""
    coupling, count = display.coupling, len(display.channels)
    off = 1.0 - np.eye(count)
    if coupling.measured is not None:
        place, lines = np.log(frequency_hz), np.log(coupling.measured.frequency_hz)
        shares, deviation = (each.reshape(lines.size, -1) for each in smooth_shares(coupling.measured))
        parts = [
            [np.interp(place, lines, column) for column in side.T] for side in (shares.real, shares.imag, deviation)
        ]
        real, imag, unsure = (np.array(part).T.reshape(-1, count, count) for part in parts)
        return np.asarray(real + 1j * imag), np.asarray(unsure, dtype=np.float64)
    path = zero_order_hold(coupling.path(), display.rate_hz).response(frequency_hz)
    late_s = np.array([channel.plant.delay_s for channel in display.channels])
    turn = np.exp(-2j * np.pi * frequency_hz[:, None, None] * (late_s[None, :] - late_s[:, None]))
    share = from_db(coupling.level_db if coupling.level_db is not None else -np.inf)
    return np.asarray(share * path[:, None, None] * off * turn), np.zeros((frequency_hz.size, count, count))


def known_hz(coupling: Coupling) -> tuple[float, float]:
    """Return from where to where a coupling is known, hertz."""
    if coupling.measured is None:
        return 0.0, np.inf
    return float(coupling.measured.frequency_hz[0]), float(coupling.measured.frequency_hz[-1])


@dataclass(frozen=True, eq=False)
class CoupledLoops:
    """The loops of all channels of a display under one load (those that do not have it are untouched)."""

    display: Display
    load: str
    loops: tuple[TwoDegreeLoop, ...]

    @cached_property
    def is_stable_alone(self) -> bool:
        """Return whether every loop by itself is stable."""
        return all(loop.feedback is None or loop.feedback.is_stable for loop in self.loops)

    def complementary(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return T of every channel by itself, (m, channels); zero without a loop."""
        none = np.zeros(frequency_hz.size, dtype=np.complex128)
        each = [none if loop.feedback is None else loop.feedback.complementary(frequency_hz) for loop in self.loops]
        return np.stack(each, axis=1)

    def motion(self, driver: int, level_db_sl: float, frequency_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the motion of every channel, peak volts of y, while one is driven at `level_db_sl`, and what it may be
        off (95 %), (m, channels) each. The others rest on their friction, where the display file states it."""
        shares, unsure = shares_at(self.display, frequency_hz)
        count = len(self.loops)
        eye = np.eye(count)
        free = np.stack([loop.plant.response(frequency_hz) for loop in self.loops], axis=1)
        ahead, back = (np.zeros((frequency_hz.size, count), dtype=np.complex128) for _ in range(2))
        for place, loop in enumerate(self.loops):
            back[:, place] = 0.0 if loop.controller is None else loop.controller.response(frequency_hz)
            if place == driver:
                ahead[:, place] = loop.prefilter.response(frequency_hz)
                ahead[:, place] *= 1.0 if loop.controller is None else back[:, place]
        ahead *= from_db(level_db_sl)
        plants = free
        for _ in range(_ROUNDS):
            through = plants[:, :, None] * (eye + shares)
            closed = eye + through * back[:, None, :]
            moved = np.linalg.solve(closed, through @ ahead[:, :, None])[:, :, 0]
            plants = self._at_rest(free, np.abs(moved), driver)
        driving = np.abs(ahead - back * moved)[:, driver]
        alone = np.abs(plants / (1.0 + plants * back))
        return np.abs(moved), RADIUS * alone * unsure[:, :, driver] * driving[:, None]

    def _at_rest(self, free: ComplexArray, moved_v: FloatArray, driver: int) -> ComplexArray:
        plants = free.copy()
        for place, channel in enumerate(self.display.channels):
            if place != driver and "friction" not in channel.environment.assumed:
                plants[:, place] = beside_friction(channel.environment, free[:, place], moved_v[:, place])
        return plants

    def stability(self) -> Finding:
        """Return the finding on whether the loops are stable together."""
        frequency = self._grid_hz()
        shares, unsure = shares_at(self.display, frequency)
        back = self.complementary(frequency)
        size = np.abs(back)[:, None, :]
        gain = np.linalg.norm((np.abs(shares) + RADIUS * unsure) * size, 2, axis=(1, 2))
        worst = int(np.argmax(gain))
        names = ", ".join(channel.name for channel in self.display.channels)
        figure, at_hz = float(gain[worst]), float(frequency[worst])
        finding = compared("v", names, self.load, TOGETHER, figure, 1.0, "", at_hz, remedy=_REMEDY)
        if finding.outcome is Outcome.MET:
            return finding
        returned = np.eye(len(self.loops)) + shares * back[:, None, :]
        turning = np.unwrap(np.angle(np.linalg.det(returned)))
        least = np.linalg.svd(returned, compute_uv=False)[:, -1]
        room = least - RADIUS * np.linalg.norm(unsure * size, 2, axis=(1, 2))
        roots = round(-(turning[-1] - turning[0]) / np.pi)
        if np.any(room <= 0.0) or np.max(np.abs(np.diff(turning))) > _STEP_RAD:
            remark = f"small gain does not tell, and det(I + K T) comes as near to zero as {np.min(least):.2g}"
            return replace(finding, outcome=Outcome.NOT_JUDGED, remark=f"{remark}: a longer record")
        if roots:
            return replace(finding, remark=f"{roots} roots of the coupled loops are unstable; {_REMEDY}")
        remark = (
            f"small gain does not tell; det(I + K T) does not turn around zero, and keeps {np.min(least):.2g} off it"
        )
        return replace(finding, outcome=Outcome.MET, remark=remark)

    def _grid_hz(self) -> FloatArray:
        coupling, top = self.display.coupling, 0.5 * self.display.rate_hz
        parts = [analysis_grid_hz(loop.feedback) for loop in self.loops if loop.feedback is not None]
        if coupling.measured is not None:
            parts.append(coupling.measured.frequency_hz)
        else:
            parts.append(coupling.resonance_hz * (1.0 + coupling.damping * np.linspace(-4.0, 4.0, 81)))
        whole = np.unique(np.concatenate(parts))
        return np.asarray(whole[(whole > 0.0) & (whole <= top)])

    def crosstalk(self) -> Iterator[Finding]:
        """Yield for every channel the finding on what is felt there while another is driven as loudly as may be."""
        level, allowed = self.display.objectives.comfort_db_sl, self.display.objectives.crosstalk_max_db_sl
        felt = [self._felt(driver, level) for driver in range(len(self.loops))]
        for place, channel in enumerate(self.display.channels):
            rows = [(driver, *columns) for driver, of in enumerate(felt) for columns in of.get(place, ())]
            if not rows:
                words = "no frequency of the band at which plants and coupling are known"
                yield Finding("v", channel.name, self.load, Outcome.NOT_JUDGED, CROSSTALK, remark=words)
                continue
            driver, at_hz, value, low, high = max(rows, key=lambda row: row[2])
            from_whom = f"from {self.display.channels[driver].name} at {level:g} dB SL"
            finding = compared("v", channel.name, self.load, CROSSTALK, value, allowed, "dB SL", at_hz, remedy=_REMEDY)
            if any(row[4] > allowed for row in rows) and not any(row[3] > allowed for row in rows):
                finding = replace(
                    finding, outcome=Outcome.NOT_JUDGED, remark="a longer record tells the coupling better"
                )
            sure = "" if high - low < 0.01 else f", {low:.1f} to {high:.1f} with 95 %"
            yield replace(finding, remark="; ".join(filter(None, (f"{from_whom}{sure}", finding.remark))))

    def _felt(self, driver: int, level_db_sl: float) -> dict[int, list[tuple[float, float, float, float]]]:
        """Return for every other channel rows of frequency, felt level, and its least and greatest with 95 %, dB SL."""
        frequency = _shared_hz(self.display)
        if frequency.size == 0:
            return {}
        moved, unsure = self.motion(driver, level_db_sl, frequency)
        rows: dict[int, list[tuple[float, float, float, float]]] = {}
        for place, channel in enumerate(self.display.channels):
            if place != driver:
                sides = (moved, np.maximum(moved - unsure, 0.0), moved + unsure)
                levels = [felt_db_sl(channel, side[:, place], frequency).tolist() for side in sides]
                rows[place] = list(zip(frequency.tolist(), *levels, strict=True))
        return rows


def _shared_hz(display: Display) -> FloatArray:
    """Return frequencies at which every channel is asked for and known, and the coupling is known, (m,)."""
    first, last = known_hz(display.coupling)
    low = max(first, *(channel.threshold.band_hz[0] for channel in display.channels))
    high = min(last, *(channel.threshold.band_hz[1] for channel in display.channels))
    frequency = np.geomspace(low, high, _POINTS) if high > low else np.empty(0)
    return frequency[np.all([channel.is_known(frequency) for channel in display.channels], axis=0)]


def coupled_loops(controller: Controller, display: Display) -> Iterator[CoupledLoops]:
    """Yield the loops of a display's channels: untouched, and under every load that any of them has."""
    rate_hz = display.rate_hz
    families = [plant_family(channel, rate_hz, display.delay_samples) for channel in display.channels]
    loads = dict.fromkeys([UNLOADED, *(member.load for family in families for member in family)])
    for load in loads:
        plants = [_under(load, family).sampled for family in families]
        parts = [controller.channel(channel.name) for channel in display.channels]
        yield CoupledLoops(
            display,
            load,
            tuple(
                TwoDegreeLoop(part.prefilter(rate_hz), part.feedback(rate_hz), plant)
                for part, plant in zip(parts, plants, strict=True)
            ),
        )


def _under(load: str, family: Sequence[Member]) -> Member:
    return next((member for member in family if member.model == 0 and member.load == load), family[0])


def judge_coupling(controller: Controller, display: Display) -> Iterator[Finding]:
    """Yield the findings on coupled channels; none of a display whose file tells of no coupling, or of one channel."""
    if not display.coupling.is_there or len(display.channels) < 2:
        return
    for loops in coupled_loops(controller, display):
        if not loops.is_stable_alone:
            continue  # which fails every objective of the loop
        if any(loop.feedback is not None for loop in loops.loops):
            stability = loops.stability()
            yield stability
            if stability.outcome is Outcome.NOT_MET:
                continue
        yield from loops.crosstalk()

"""The whole verdict on a controller: the paper's four objectives (its section 2), and building an image.

Objectives are judged by the controller's own sections and a display's figures. What the display file does not give is
assumed; what depends on an assumption is reported, not judged. A band's noise is judged by its rms times the root of
two, the peak of the sinusoid of the same power.

On plants that were drawn (`monte_carlo`), a limit is kept if, with that many plants, no more than one in twenty exceeds
it, an unstable loop passing every limit; and no loop at all may be unstable. The number of plants that pass is
binomial: its exact tails exclude, with 95 % confidence, a share of 5 % from above (met) or from below (not met), or
neither (not judged; more plants would help). (Clopper & Pearson 1934, "The use of confidence or fiducial limits
illustrated in the case of the binomial", Biometrika 26.)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np
import scipy

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.controller import ChannelController, Controller, FeedForward, StrengthShaping
from tactuator.model.description import Channel, Display
from tactuator.model.plausibility import doubtful
from tactuator.model.verdict import (
    AS_IN_TEMPLATE,
    AT_LOWEST,
    FELT_HUM,
    FELT_NOISE,
    FELT_STEPS,
    HEADROOM,
    LEVEL_ERROR,
    MODE_OFF,
    OF_THE_LOOP,
    Finding,
    Outcome,
    Verdict,
    compared,
    in_jnd,
    rests_on,
    verdict_of,
)
from tactuator.signals.decibels import db
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.signals.loop_figures import around_modes_hz, margins
from tactuator.signals.spectra import third_octave_bands
from tactuator.synthesis.design import headroom, headroom_grid_hz
from tactuator.synthesis.family import UNLOADED, Member, can_be_unconditionally_stable, plant_family
from tactuator.synthesis.felt import felt_db_sl, felt_hum_v, felt_noise_rms_v, friction_loss_db, steps_change_db
from tactuator.synthesis.monte_carlo import SHIFT, DrawnPlants, light_roots, moved_root
from tactuator.synthesis.prefilter import band_grid_hz, response_error_db
from tactuator.synthesis.strength import JUDGED_DB_SL, furthest, shaping_error_db
from tactuator.synthesis.touch import fed_response
from tactuator.wordlength.float32_check import buildable

_POINTS = 600
"""Frequencies over the band at which an objective is tested: about 1 % apart."""
_ROUNDS, _TOLD_DB = 16, 0.005
"""Rounds of friction's answer to its own motion; contribution to an error from which on its cause is named."""
RESONANCE = "max|T|"
_FLATNESS_REMEDY, _RESHAPING = "more poles in [prefilter], or a wider flatness_db", "reshaping"
NOISE_REMEDY = "less noise at the sensor, or a lower command_noise_gain_max"
_WIDENS = {
    "travel": "more travel_mm",
    "command": "a stronger motor, a greater range_v",
    "comfort": "more comfort_db_sl",
}
_LESS_GAIN = "another C: this one is unstable at lower gains, which is what a command at its limit comes to"
_RUNS_AWAY = (
    "for information only: no loop around this plant is stable at every lower gain; a board's guard ends a run that "
    "grows below it"
)
NO_LOOP = "no loop carries what the sensor hears to the finger; the amplifier's own was not measured"


def whole_verdict(controller: Controller, display: Display | None = None, drawn: Sequence[DrawnPlants] = ()) -> Verdict:
    """Return the verdict on the objectives and on building an image, for `display` (None: the controller's own), and on
    the plants `drawn` for it, if any.
    """
    judged = judge(controller, display)
    shown = controller if display is None else replace(controller, display=display)
    findings = [finding for objective in judged.objectives for finding in objective.findings]
    findings += judge_drawn(drawn, shown.display)
    findings += [buildable(shown), *doubtful(shown.display)]
    return verdict_of(findings, (*judged.assumptions, *drawn_assumptions(drawn)), shown.display.channels)


def judge(controller: Controller, display: Display | None = None) -> Verdict:
    """Return the verdict on `controller` for `display` (None: the one it was designed for).

    A loop that is unstable under some load fails every objective, and its findings say so. Raises BadInput where the
    display's channels, rate or delay are not the controller's, or its limits lie beyond the display's.
    """
    shown = controller.display if display is None else display
    controller.require_runs(shown)
    controller.require_limits_of(shown)
    findings: list[Finding] = []
    for channel in shown.channels:
        findings += judge_channel(controller.channel(channel.name), channel, shown)
    return verdict_of(findings, assumptions(shown), shown.channels)


def assumptions(display: Display) -> tuple[str, ...]:
    """Return what the display file leaves to be assumed, one sentence each."""
    sentences: list[str] = []
    for channel in display.channels:
        environment = channel.environment
        lines = zip(environment.hum_hz, environment.hum_v_peak, strict=True)
        figures = {
            "hum": ", ".join(f"{1e3 * v:g} mV at {f:g} Hz" for f, v in lines) or "none",
            "noise": f"{1e3 * environment.noise_v_rms:g} mV rms",
            "friction": f"{1e3 * environment.friction_v:g} mV of command",
            "presliding": f"{1e3 * environment.presliding_v:g} mV of the sensor",
        }
        sentences += [
            f"{what}: {figures[what]}, for want of a figure in the display file" for what in environment.assumed
        ]
        sentences += [f"{channel.name}: {', '.join(channel.unchanged)} {AS_IN_TEMPLATE}"] if channel.unchanged else []
    return tuple(sentences)


def hum_remedy(line_hz: float) -> str:
    """Return what to change where a mains line is felt."""
    return f"a lower |T| at {line_hz:g} Hz (mains_max_db), or less hum at the sensor"


@dataclass(frozen=True)
class _Judge:
    """One channel under one member of its family; free: the loop of the same model without load."""

    channel: Channel
    display: Display
    member: Member
    loop: TwoDegreeLoop
    nominal: TwoDegreeLoop
    free: TwoDegreeLoop
    feed_forward: FeedForward | None = None
    strength: StrengthShaping | None = None

    def open(self, objective: str, quantity: str, remark: str) -> Finding:
        channel, load, whose = self.channel.name, self.member.name, self.member.measured
        return Finding(objective, channel, load, Outcome.NOT_JUDGED, quantity, remark=remark, model=whose)

    def compared(
        self, kind: tuple[str, str], figure: tuple[float, float, str], at_hz: float | None, remedy: str, *assumed: str
    ) -> Finding:
        """Return the finding on a figure (value, what is allowed, unit) of one kind (objective, quantity)."""
        (objective, quantity), (value, allowed, unit), rests = kind, figure, " and ".join(assumed)
        channel, load = self.channel.name, self.member.name
        judged = compared(objective, channel, load, quantity, value, allowed, unit, at_hz, assumed=rests, remedy=remedy)
        return replace(judged, model=self.member.measured)

    def flatness(self) -> Finding:
        """Judge objective i, with what the plant's magnitude may be off, over the frequencies where the plant is known;
        under a load, where feedback cannot help above its bandwidth, the figure is for information only.
        """
        frequency = band_grid_hz(self.channel, _POINTS)
        frequency = frequency[self.channel.is_known(frequency)]
        if frequency.size == 0:
            return self.open("i", LEVEL_ERROR, self.channel.known_words)
        error = response_error_db(self.channel, self.loop, frequency)
        levels = (self.channel.strength.strength_db_sl,) if self.strength is None else JUDGED_DB_SL
        error = furthest([error + self._shaped(frequency, level)[1] for level in levels])
        worst, unsure_db = int(np.argmax(np.abs(error))), self.channel.model_error_db
        figure = float(abs(error[worst])) + unsure_db, self.display.objectives.flatness_db, "dB"
        finding = self.compared(("i", LEVEL_ERROR), figure, float(frequency[worst]), _FLATNESS_REMEDY)
        remark = "; ".join(filter(None, [in_jnd(figure[0]), finding.remark]))
        finding = replace(finding, remark=remark, side=float(np.sign(error[worst])))
        finding = _unsure(finding, self.channel) if unsure_db > 0.0 else finding
        if self.member.load == UNLOADED:
            return finding
        return replace(_open(finding, "for information only: objective iv judges what a load changes"), counts=False)

    def moved_mode(self) -> Iterator[Finding]:
        """Tell what is felt without a loop where the frequency of one lightly damped mode is off, in the worst case."""
        channel, allowed_db = self.channel, self.display.objectives.flatness_db
        roots = list(light_roots(channel))
        if self.loop.feedback is not None or not roots:
            return
        low, high = channel.threshold.band_hz
        around = around_modes_hz(np.array([root for root, _ in roots]))
        near = around[(around >= low) & (around <= high)]
        frequency = np.union1d(band_grid_hz(channel, _POINTS), near)
        frequency = frequency[channel.is_known(frequency)]
        if frequency.size == 0:
            return
        error = response_error_db(channel, self.loop, frequency)
        changes = [
            sign * db(np.abs(moved_root(root, moved, frequency)))
            for root, sign in roots
            for moved in (1.0 - SHIFT, 1.0 + SHIFT)
        ]
        worst = furthest([error + change for change in changes])
        place = int(np.argmax(np.abs(worst)))
        figure = float(abs(worst[place])), allowed_db, "dB"
        finding = self.compared(("i", MODE_OFF), figure, float(frequency[place]), "")
        remark = f"for information only: {in_jnd(figure[0])}; `tactuator check --monte-carlo` draws such plants"
        yield replace(_open(finding, remark), side=float(np.sign(worst[place])), counts=False)

    def _shaped(self, frequency: FloatArray, level: float) -> tuple[FloatArray, FloatArray]:
        """Return the level asked for at a strength level, dB SL, and the error against it of a reference's reshaping,
        or of the one contour that the prefilter follows, dB.
        """
        asked, contours = self.channel.strength, self.channel.strength.contours
        wanted, made_for = asked.asked_db_sl(level, frequency), asked.strength_db_sl
        if self.strength is not None and contours is not None:
            return wanted, shaping_error_db(self.strength, level, contours, frequency, self.display.rate_hz)
        return wanted, asked.asked_db_sl(made_for, frequency) - made_for - (wanted - level)

    def lowest(self) -> Iterator[Finding]:
        """Judge objective i at `from_db_sl`, beside the friction that the display file states, the converters' steps
        and the contour of another level, and say from which level up it holds.
        """
        channel, asked, allowed = self.channel, self.display.objectives, self.display.objectives.flatness_db
        frequency = band_grid_hz(channel, _POINTS)[:: _POINTS // 200]
        frequency = frequency[channel.is_known(frequency)]
        if frequency.size == 0:
            return
        linear = response_error_db(channel, self.loop, frequency)
        error, beside = self._beside(frequency, linear, asked.from_db_sl)
        causes = self._causes(*beside)
        if causes.keys() <= {_RESHAPING}:
            return  # objective i holds it at every level
        place, certain = int(np.argmax(np.abs(error))), allowed - channel.model_error_db
        side = "weaker" if error[place] < 0.0 else "stronger"
        remark = f"at {asked.from_db_sl:g} dB SL, with {' and '.join(causes)}: {side} than asked"
        _, remedy = max(causes.values(), key=lambda cause: cause[0][place])
        if abs(error[place]) > certain:
            higher = [level for level in reversed(JUDGED_DB_SL) if level > asked.from_db_sl]
            others = ((level, self._beside(frequency, linear, level)[0]) for level in higher)
            holds = [level for level, _ in takewhile(lambda other: np.abs(other[1]).max() <= certain, others)]
            greatest = max(JUDGED_DB_SL[-1], asked.from_db_sl)
            nowhere = f"; it holds at no level up to {greatest:g} dB SL"
            remedy += f", or [objectives] from_db_sl = {holds[-1]:g}" if holds else nowhere
        figure = float(abs(error[place])) + channel.model_error_db, allowed, "dB"
        assumed = {"presliding"} & set(channel.environment.assumed) if "friction" in causes else ()
        finding = self.compared(("i", AT_LOWEST), figure, float(frequency[place]), remedy, *assumed)
        remark = "; ".join(filter(None, [remark, finding.remark]))
        finding = replace(finding, remark=remark, side=float(np.sign(error[place])))
        yield _unsure(finding, channel) if channel.model_error_db > 0.0 else finding

    def _beside(
        self, frequency: FloatArray, linear: FloatArray, strength_db_sl: float
    ) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray]]:
        """Return the furthest error at a level, dB, and what is in it beside the loop's own error `linear`: the
        reference's shape, what friction takes, (n,), and the converters' steps, (k, n).
        """
        channel, environment = self.channel, self.channel.environment
        rubs = environment.friction_v > 0.0 and "friction" not in environment.assumed
        level, shaping = self._shaped(frequency, strength_db_sl)
        friction = friction_loss_db(channel, self.loop, frequency, level, _ROUNDS) if rubs else 0.0 * linear
        steps = steps_change_db(channel, self.loop, frequency, level)
        return furthest(list(linear + shaping - friction + steps)), (shaping, friction, steps)

    def _causes(
        self, shaping: FloatArray, friction: FloatArray, steps: FloatArray
    ) -> dict[str, tuple[FloatArray, str]]:
        """Return the relevant causes by name: their share, dB, (n,), and what would help."""
        less = f"less friction than {1e3 * self.channel.environment.friction_v:.3g} mV of command"
        causes = {
            "friction": (np.abs(friction), less),
            "steps": (np.max(np.abs(steps), axis=0), f"more than {self.channel.converter.bits} bits"),
        }
        if self.strength is None:
            causes["one contour"] = np.abs(shaping), "[strength] blended = true"
        else:
            causes[_RESHAPING] = np.abs(shaping), _FLATNESS_REMEDY
        return {word: cause for word, cause in causes.items() if cause[0].max() >= _TOLD_DB}

    def reach(self) -> Iterator[Finding]:
        """Judge objective i: travel, command and comfort have to leave the threshold within reach all over the band."""
        grid = headroom_grid_hz(self.channel)
        grid = grid[self.channel.is_known(grid)]
        if grid.size:
            room = headroom(self.channel, self.loop, grid, self.display.objectives.comfort_db_sl, self._fed(grid))
            room = room.before(self.strength, self.display.rate_hz)
            worst = int(np.argmin(room.level_db_sl))
            at, level, stops = float(grid[worst]), float(room.level_db_sl[worst]), room.binding[worst]
            remedy = f"{stops} stops at {level:.1f} dB SL: {_WIDENS[stops]}, or a band_hz without {at:.4g} Hz"
            yield self.compared(("i", HEADROOM), (-level, 0.0, "dB"), at, remedy)

    def _fed(self, frequency_hz: FloatArray) -> ComplexArray | None:
        """Return H where a finger is fed forward, (n,), or None."""
        fed, rate_hz = self.feed_forward, self.display.rate_hz
        return fed_response(fed, self.channel, self.nominal, self.loop, self.member.load, frequency_hz, rate_hz)

    def lower_gain(self, bears_less: bool) -> Iterator[Finding]:
        """Judge objective iii: a clipped command acts like a loop of lower gain, which must be stable, too. If the
        plant does not allow that, it is reported.
        """
        if self.loop.feedback is not None:
            kind, least = ("iii", "gain below which it is unstable"), 100.0 * margins(self.loop.feedback).least_gain
            finding = self.compared(kind, (least, 0.0, "%"), None, _LESS_GAIN)
            if bears_less or least == 0.0:
                yield finding
            else:
                yield replace(_open(finding, _RUNS_AWAY), counts=False)

    def unknown(self) -> Iterator[Finding]:
        """Report where band and crossover leave the frequencies at which the plant is known."""
        if self.channel.unknown_words:
            yield self.open("i", f"{LEVEL_ERROR} beyond the known band", self.channel.known_words)
        if self.loop.feedback is not None:
            crossover_hz = margins(self.loop.feedback).crossover_hz
            if not (np.isnan(crossover_hz) or self.channel.is_known(crossover_hz)):
                words = f"the crossover is at {crossover_hz:.4g} Hz; {self.channel.known_words}"
                yield self.open("iii", RESONANCE, words)

    def mains(self) -> Iterator[Finding]:
        environment = self.channel.environment
        if self.loop.feedback is None:
            yield self.open("ii", FELT_HUM, NO_LOOP)
        elif not environment.hum_hz:
            yield self.open("ii", FELT_HUM, "the display file names no mains line (hum_hz)")
        else:
            lines = np.array(environment.hum_hz)
            levels = felt_db_sl(self.channel, felt_hum_v(self.channel, self.loop), lines)
            unknown = [what for what in ("hum", "friction") if what in environment.assumed]
            for line, level in zip(lines.tolist(), levels.tolist(), strict=True):
                figure = level, self.display.objectives.mains_max_db_sl, "dB SL"
                assumed = [*unknown, *_guessed(self.channel, line)]
                yield self.compared(("ii", FELT_HUM), figure, line, hum_remedy(line), *assumed)

    def noise(self) -> Iterator[Finding]:
        """Judge objective iii: the worst third octave, and the loop's resonance."""
        low, high = self.channel.threshold.band_hz
        bands, allowed, feedback = third_octave_bands(low, high), self.display.objectives, self.loop.feedback
        if bands:
            edges = np.array([[band.low_hz, band.high_hz] for band in bands])
            centres = np.array([band.centre_hz for band in bands])
            peak = np.sqrt(2.0) * felt_noise_rms_v(self.channel, self.loop, self.display.rate_hz, edges)
            level = felt_db_sl(self.channel, peak, np.clip(centres, low, high))
            worst = int(np.argmax(level))
            at = float(centres[worst])
            assumed = ["noise"] if feedback is not None and "noise" in self.channel.environment.assumed else []
            quantity = FELT_STEPS if feedback is None else FELT_NOISE
            figure = float(level[worst]), allowed.noise_max_db_sl, "dB SL"
            yield self.compared(("iii", quantity), figure, at, NOISE_REMEDY, *assumed, *_guessed(self.channel, at))
        else:
            yield self.open("iii", FELT_NOISE, f"no third octave lies within {low:g} to {high:g} Hz")
        if feedback is not None:
            peak_t = margins(feedback).complementary
            remedy = "a lower sensitivity_peak or a greater phase_margin_deg"
            figure = peak_t.value, allowed.resonance_peak, ""
            yield self.compared(("iii", RESONANCE), figure, peak_t.frequency_hz, remedy)

    def load(self) -> Finding:
        """Judge objective iv; the worst change over the band is also reported. A controller that feeds forward for a
        finger is judged over the whole band, with the weights that it finds.
        """
        asked, frequency = self.display.objectives, band_grid_hz(self.channel, _POINTS)
        fed = self._fed(frequency)
        response = self.loop.moved_response(frequency) if fed is None else fed
        change = db(np.abs(response) / np.abs(self.free.moved_response(frequency)))
        edge_hz = asked.load_band_hz if self.feed_forward is None else np.inf
        low = (frequency <= edge_hz) & self.channel.is_known(frequency)
        worst = int(np.argmax(np.abs(change)))
        whole = f"over the band {change[worst]:+.2f} dB at {frequency[worst]:.3g} Hz"
        if not np.any(low):
            below = f"no frequency of the band up to load_band_hz {asked.load_band_hz:g}"
            return self.open("iv", "change of |H|", f"{below} at which the plant is known; {whole}")
        place = int(np.argmax(np.abs(change[low])))
        figure = float(np.abs(change[low])[place]), asked.load_max_db, "dB"
        finding = self.compared(("iv", "change of |H|"), figure, float(frequency[low][place]), self._against_loads())
        return replace(finding, remark=f"{finding.remark}; {whole}" if finding.remark else whole)

    def _against_loads(self) -> str:
        if self.loop.feedback is None:
            return "a loop: nothing else holds the position against a load"
        if self.feed_forward is None:
            return "more rejection at low frequencies (rejection_max_db)"
        first, most = self.channel.loads[0].name, self.feed_forward.weight_max
        return f"another load first in loads: fed forward is for {first!r}, up to {most:g} times its figures"


def judge_channel(controller: ChannelController, channel: Channel, display: Display) -> Iterator[Finding]:
    """Yield the findings on one channel, member by member of its family."""
    family = plant_family(channel, display.rate_hz, display.delay_samples)
    prefilter, feedback = controller.prefilter(display.rate_hz), controller.feedback(display.rate_hz)
    loops = [TwoDegreeLoop(prefilter, feedback, member.sampled) for member in family]
    stable = [loop.feedback is None or loop.feedback.is_stable for loop in loops]
    bears_less = can_be_unconditionally_stable(family)
    for member, loop, is_stable in zip(family, loops, stable, strict=True):
        bare = member.model * (1 + len(channel.loads))  # the same model without load
        besides = controller.feed_forward, controller.strength
        judge = _Judge(channel, display, member, loop, loops[0], loops[bare], *besides)
        if not is_stable:
            remedy = "a design for this display: the loop of this controller is unstable on it"
            for number in OF_THE_LOOP:
                unstable = judge.open(number, "the closed loop is unstable", remedy)
                yield replace(unstable, outcome=Outcome.NOT_MET)
            continue
        if member is family[0]:
            yield from judge.unknown()
            yield from judge.lowest()
            yield from judge.moved_mode()
        yield judge.flatness()
        yield from judge.reach()
        yield from judge.lower_gain(bears_less)
        yield from judge.mains()
        yield from judge.noise()
        if member.load != UNLOADED and stable[0] and stable[bare]:
            yield judge.load()
    if not channel.loads:
        nominal = _Judge(channel, display, family[0], loops[0], loops[0], loops[0])
        yield nominal.open("iv", "change of |H|", "the display file describes no load (loads)")


def _unsure(finding: Finding, channel: Channel) -> Finding:
    """Return a finding on |H| whose value holds what the plant is unsure of: not judged where that decides."""
    most, allowed = finding.value or 0.0, finding.allowed or 0.0
    unsure_db = channel.model_error_db
    share = f"of which {unsure_db:.2f} dB that the plant itself is unsure of"
    if most <= allowed or most - 2.0 * unsure_db > allowed:
        return replace(finding, remark=f"{finding.remark}; {share}" if finding.remark else share)
    pair = channel.model_error_hz
    where = "" if pair is None else f", most of all between {pair[0]:.4g} and {pair[1]:.4g} Hz"
    return _open(finding, f"{share}: more points of its response{where}")


def _open(finding: Finding, why: str) -> Finding:
    return replace(finding, outcome=Outcome.NOT_JUDGED, remark=why)


def _guessed(channel: Channel, frequency_hz: float) -> list[str]:
    return [] if channel.is_known(frequency_hz) else [f"the plant at {frequency_hz:.4g} Hz"]


MAY_PASS, CONFIDENCE = 0.05, 0.95
"""Share of plants that may exceed a limit, and the confidence of that statement."""
_UNSTABLE = "unstable loops"


def judge_drawn(drawn: Sequence[DrawnPlants], display: Display) -> list[Finding]:
    """Return the findings on plants drawn for `display`'s channels: stability and max|S| (iii), flatness without load
    (i), felt hum (ii)."""
    return [finding for plants in drawn for finding in _findings(plants, display.channel(plants.channel), display)]


def drawn_assumptions(drawn: Sequence[DrawnPlants]) -> tuple[str, ...]:
    """Return what the draws assume, one sentence each."""
    shifts = {plants.channel: plants.mode_shift for plants in drawn if plants.mode_shift > 0.0}
    return tuple(
        f"modes of {name}: {100.0 * shift:g} % of standard deviation in frequency (`mode_shift`)"
        for name, shift in shifts.items()
    )


def _findings(plants: DrawnPlants, channel: Channel, display: Display) -> Iterator[Finding]:
    asked = display.objectives
    if np.any(np.isfinite(plants.sensitivity_peak)) or plants.unstable > 0.0:
        yield _judged(plants, "iii", _UNSTABLE, np.where(plants.stable, 0.0, 100.0), 0.0, "%")
        peak = channel.feedback.sensitivity_peak
        if peak is not None:
            yield _judged(plants, "iii", "max|S|", plants.sensitivity_peak, peak, "")
    if plants.load == UNLOADED:
        errors = plants.flatness_db + channel.model_error_db
        flat = _judged(plants, "i", LEVEL_ERROR, errors, asked.flatness_db, "dB")
        flat = _unsure(flat, channel) if channel.model_error_db > 0.0 else flat
        yield _open(flat, "the plant is not known over the whole band (valid_hz)") if channel.unknown_words else flat
    if np.any(np.isfinite(plants.felt_hum_db_sl)):
        hum = _judged(plants, "ii", FELT_HUM, plants.felt_hum_db_sl, asked.mains_max_db_sl, "dB SL")
        assumed = [what for what in ("hum", "friction") if what in channel.environment.assumed]
        yield _open(hum, rests_on(" and ".join(assumed))) if assumed else hum


def _judged(
    plants: DrawnPlants, objective: str, quantity: str, values: FloatArray, allowed: float, unit: str
) -> Finding:
    """Return the finding that no more than `MAY_PASS` of the plants pass `allowed`."""
    passing = int(np.sum(~(values <= allowed)))
    few = float(scipy.special.bdtr(passing, plants.count, MAY_PASS)) <= 1.0 - CONFIDENCE
    many = passing > 0 and float(scipy.special.bdtrc(passing - 1, plants.count, MAY_PASS)) <= 1.0 - CONFIDENCE
    named, value = f"{quantity}, 95 % of plants", 100.0 * plants.unstable
    if quantity == _UNSTABLE:
        named, few, many = quantity, few and passing == 0, passing > 0
    else:
        value = float(np.quantile(np.where(np.isfinite(values), values, np.inf), 1.0 - MAY_PASS, method="higher"))
    share = f"{passing} of {plants.count} plants drawn from the {plants.source} exceed it"
    outcome, remark = Outcome.NOT_JUDGED, f"{share}: too few to tell whether 5 % do; more plants (`monte_carlo`)"
    if few:
        outcome, remark = Outcome.MET, share
    elif many:
        outcome, remark = Outcome.NOT_MET, f"{share}; more reserve in [feedback], or a plant that is better known"
    if plants.source == "nominal":
        outcome = Outcome.NOT_JUDGED
        remark = "the spread of the plant is unknown; use a model from `identify`, a covariance or a family"
    value_or_none = value if np.isfinite(value) else None
    return Finding(objective, plants.channel, plants.load, outcome, named, value_or_none, allowed, unit, remark=remark)

"""The whole verdict on a controller: the paper's four objectives (its section 2), and building an image.

Objectives are judged by the controller's own sections and a display's figures. What the display file does not say is
assumed, and what rests on an assumption is told but not judged. A band's noise is judged by its rms times the root of
two, the peak of the sinusoid of the same power.

On plants that were drawn (`monte_carlo`), a limit is kept if, as far as that many plants can tell, no more than one in
twenty passes it, an unstable loop passing every limit; and no loop at all may be unstable. The number of plants that
pass is binomial: its exact tails exclude, with 95 % confidence, a share of 5 % from above (met) or from below (not
met), or neither (not judged; more plants would tell). (Clopper & Pearson 1934, "The use of confidence or fiducial
limits illustrated in the case of the binomial", Biometrika 26.)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.controller import ChannelController, Controller, FeedForward
from tactuator.model.description import Channel, Display
from tactuator.model.verdict import OF_THE_LOOP, Finding, Outcome, Verdict, compared, rests_on, verdict_of
from tactuator.signals.decibels import db
from tactuator.signals.loop import TwoDegreeLoop, margins
from tactuator.signals.spectra import third_octave_bands
from tactuator.synthesis.family import UNLOADED, Member, plant_family
from tactuator.synthesis.felt import felt_db_sl, felt_hum_v, felt_noise_rms_v
from tactuator.synthesis.monte_carlo import DrawnPlants
from tactuator.synthesis.touch import adapted_response
from tactuator.wordlength.assessment import buildable

_POINTS = 600
_DB, _DB_SL = "dB", "dB SL"
FELT_HUM, FELT_NOISE, RESONANCE = "felt hum", "felt noise", "max|T|"
NOISE_REMEDY = "less noise at the sensor, or a lower command_noise_gain_max"
NO_LOOP = "no loop carries what the sensor hears to the finger; the amplifier's own was not measured"


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
    return verdict_of(findings, assumptions(shown))


def assumptions(display: Display) -> tuple[str, ...]:
    """Return what the display file leaves to be assumed, one sentence each."""
    told: list[str] = []
    for channel in display.channels:
        environment = channel.environment
        figures = {
            "hum": ", ".join(f"{1e3 * v:g} mV at {f:g} Hz" for f, v in _hum(channel)) or "none",
            "noise": f"{1e3 * environment.noise_v_rms:g} mV rms",
            "friction": f"{1e3 * environment.friction_v:g} mV of command",
        }
        told += [f"{what}: {figures[what]}, for want of a figure in the display file" for what in environment.assumed]
    return tuple(told)


def _hum(channel: Channel) -> Iterator[tuple[float, float]]:
    return zip(channel.environment.hum_hz, channel.environment.hum_v_peak, strict=True)


def hum_remedy(line_hz: float) -> str:
    """Return what to change where a mains line is felt."""
    return f"a lower |T| at {line_hz:g} Hz (mains_max_db), or less hum at the sensor"


@dataclass(frozen=True)
class _Judge:
    """One channel under one member of its family."""

    channel: Channel
    display: Display
    member: Member
    loop: TwoDegreeLoop
    nominal: TwoDegreeLoop
    feed_forward: FeedForward | None = None

    def open(self, objective: str, quantity: str, remark: str, *, counts: bool = True) -> Finding:
        """Return a finding that was not judged, and why."""
        return Finding(
            objective,
            self.channel.name,
            self.member.name,
            Outcome.NOT_JUDGED,
            quantity,
            remark=remark,
            counts=counts,
        )

    def flatness(self) -> Finding:
        """Judge objective i, with what the plant's magnitude may be off, over the frequencies where the plant is known;
        under a load, where feedback cannot help above its bandwidth, the figure is told only.
        """
        frequency = _known_part(self.channel, _band(self.channel))
        if frequency.size == 0:
            return self.open("i", "error of |H|", _known_words(self.channel))
        error = db(np.abs(self.loop.position_response(frequency)) / self.channel.threshold_voltage(frequency))
        worst, unsure_db = int(np.argmax(np.abs(error))), self.channel.model_error_db
        found = compared(
            "i",
            self.channel.name,
            self.member.name,
            "error of |H|",
            float(abs(error[worst])) + unsure_db,
            self.display.objectives.flatness_db,
            _DB,
            float(frequency[worst]),
            remedy="more poles in [prefilter], or a wider flatness_db",
        )
        if unsure_db > 0.0:
            found = unsure(found, self.channel)
        if self.member.load == UNLOADED:
            return found
        told = "told only: what a load changes is objective iv's"
        return replace(found, outcome=Outcome.NOT_JUDGED, remark=told, counts=False)

    def unknown(self) -> Iterator[Finding]:
        """Tell where band and crossover leave the frequencies at which the plant is known."""
        low, high = self.channel.threshold.band_hz
        if not all(self.channel.is_known(edge) for edge in (low, high)):
            yield self.open("i", "error of |H| beyond the known band", _known_words(self.channel))
        if self.loop.feedback is not None:
            crossover_hz = margins(self.loop.feedback).crossover_hz
            if not (np.isnan(crossover_hz) or self.channel.is_known(crossover_hz)):
                words = f"the crossover is at {crossover_hz:.4g} Hz; {_known_words(self.channel)}"
                yield self.open("iii", RESONANCE, words)

    def mains(self) -> Iterator[Finding]:
        """Judge objective ii, line by line."""
        environment = self.channel.environment
        if self.loop.feedback is None:
            yield self.open("ii", FELT_HUM, NO_LOOP)
            return
        if not environment.hum_hz:
            yield self.open("ii", FELT_HUM, "the display file names no mains line (hum_hz)")
            return
        lines = np.array(environment.hum_hz)
        levels = felt_db_sl(self.channel, felt_hum_v(self.channel, self.loop), lines)
        unknown = [what for what in ("hum", "friction") if what in environment.assumed]
        for line, level in zip(lines.tolist(), levels.tolist(), strict=True):
            yield compared(
                "ii",
                self.channel.name,
                self.member.name,
                FELT_HUM,
                level,
                self.display.objectives.mains_max_db_sl,
                _DB_SL,
                line,
                assumed=" and ".join([*unknown, *_guessed(self.channel, line)]),
                remedy=hum_remedy(line),
            )

    def noise(self) -> Iterator[Finding]:
        """Judge objective iii: the worst third octave, and the loop's resonance."""
        low, high = self.channel.threshold.band_hz
        bands = third_octave_bands(low, high)
        allowed = self.display.objectives
        if bands:
            edges = np.array([[band.low_hz, band.high_hz] for band in bands])
            centres = np.array([band.centre_hz for band in bands])
            peak = np.sqrt(2.0) * felt_noise_rms_v(self.channel, self.loop, self.display.rate_hz, edges)
            level = felt_db_sl(self.channel, peak, np.clip(centres, low, high))
            worst = int(np.argmax(level))
            looped = self.loop.feedback is not None
            yield compared(
                "iii",
                self.channel.name,
                self.member.name,
                FELT_NOISE if looped else "felt steps of the D/A",
                float(level[worst]),
                allowed.noise_max_db_sl,
                _DB_SL,
                float(centres[worst]),
                assumed=" and ".join(
                    ["noise"] * (looped and "noise" in self.channel.environment.assumed)
                    + _guessed(self.channel, float(centres[worst]))
                ),
                remedy=NOISE_REMEDY,
            )
        else:
            yield self.open("iii", FELT_NOISE, f"no third octave lies within {low:g} to {high:g} Hz")
        if self.loop.feedback is not None:
            peak_t = margins(self.loop.feedback).complementary
            yield compared(
                "iii",
                self.channel.name,
                self.member.name,
                RESONANCE,
                peak_t.value,
                allowed.resonance_peak,
                "",
                peak_t.frequency_hz,
                remedy="a lower sensitivity_peak or a greater phase_margin_deg",
            )

    def _loaded_response(self, frequency_hz: FloatArray) -> ComplexArray:
        if self.feed_forward is None:
            return self.loop.position_response(frequency_hz)
        load = self.channel.load(self.member.load)
        rate_hz = self.display.rate_hz
        return adapted_response(self.feed_forward, self.nominal, self.loop, load, frequency_hz, rate_hz)

    def load(self) -> Finding:
        """Judge objective iv; the worst change over the band is told beside it. A controller that feeds forward for a
        finger is judged over the whole band, with the weights that it finds.
        """
        asked = self.display.objectives
        frequency = _band(self.channel)
        change = db(np.abs(self._loaded_response(frequency)) / np.abs(self.nominal.position_response(frequency)))
        edge_hz = asked.load_band_hz if self.feed_forward is None else np.inf
        low = (frequency <= edge_hz) & self.channel.is_known(frequency)
        worst = int(np.argmax(np.abs(change)))
        told = f"over the band {change[worst]:+.2f} dB at {frequency[worst]:.3g} Hz"
        if not np.any(low):
            below = f"no frequency of the band up to load_band_hz {asked.load_band_hz:g}"
            return self.open("iv", "change of |H|", f"{below} at which the plant is known; {told}")
        place = int(np.argmax(np.abs(change[low])))
        found = compared(
            "iv",
            self.channel.name,
            self.member.name,
            "change of |H|",
            float(np.abs(change[low])[place]),
            asked.load_max_db,
            _DB,
            float(frequency[low][place]),
            remedy=self._against_loads(),
        )
        return replace(found, remark=f"{found.remark}; {told}" if found.remark else told)

    def _against_loads(self) -> str:
        """Return what would help a display that a load changes."""
        if self.loop.feedback is None:
            return "a loop: nothing else holds the position against a load"
        if self.feed_forward is None:
            return "more rejection at low frequencies (rejection_max_db)"
        first, most = self.channel.loads[0].name, self.feed_forward.weight_max
        return f"another load first in loads: fed forward is for {first!r}, up to {most:g} times its figures"


def judge_channel(own: ChannelController, channel: Channel, display: Display) -> Iterator[Finding]:
    """Yield the findings on one channel, member by member of its family."""
    family = plant_family(channel, display.rate_hz, display.delay_samples)
    prefilter, feedback = own.prefilter(display.rate_hz), own.feedback(display.rate_hz)
    loops = [TwoDegreeLoop(prefilter, feedback, member.sampled) for member in family]
    for member, loop in zip(family, loops, strict=True):
        judge = _Judge(channel, display, member, loop, loops[0], own.feed_forward)
        if not _is_stable(loop):
            yield from _unstable(judge)
            continue
        yield judge.flatness()
        if member is family[0]:
            yield from judge.unknown()
        yield from judge.mains()
        yield from judge.noise()
        if member.load != UNLOADED and _is_stable(loops[0]):
            yield judge.load()
    if not channel.loads:
        nominal = _Judge(channel, display, family[0], loops[0], loops[0])
        yield nominal.open("iv", "change of |H|", "the display file describes no load (loads)")


def unsure(found: Finding, channel: Channel) -> Finding:
    """Return a finding on |H| whose value holds what the plant is unsure of: not judged where that decides."""
    most, allowed = found.value or 0.0, found.allowed or 0.0
    unsure_db = channel.model_error_db
    told = f"of which {unsure_db:.2f} dB that the plant itself is unsure of"
    if most <= allowed or most - 2.0 * unsure_db > allowed:
        return replace(found, remark=f"{found.remark}; {told}" if found.remark else told)
    pair = channel.model_error_hz
    where = "" if pair is None else f", most of all between {pair[0]:.4g} and {pair[1]:.4g} Hz"
    return replace(found, outcome=Outcome.NOT_JUDGED, remark=f"{told}: more points of its response{where}")


def _unstable(judge: _Judge) -> Iterator[Finding]:
    remedy = "a design for this display: the loop of this controller is unstable on it"
    for number in OF_THE_LOOP:
        yield Finding(
            number, judge.channel.name, judge.member.name, Outcome.NOT_MET, "the closed loop is unstable", remark=remedy
        )


def _is_stable(loop: TwoDegreeLoop) -> bool:
    return loop.feedback is None or loop.feedback.is_stable


def _band(channel: Channel) -> FloatArray:
    low, high = channel.threshold.band_hz
    own = channel.threshold.curve.frequency_hz
    return np.unique(np.append(np.geomspace(low, high, _POINTS), own[(own >= low) & (own <= high)]))


def _known_part(channel: Channel, frequency_hz: FloatArray) -> FloatArray:
    return np.asarray(frequency_hz[channel.is_known(frequency_hz)])


def _known_words(channel: Channel) -> str:
    low, high = channel.valid_hz or (0.0, np.inf)
    return f"the plant is known from {low:.4g} to {high:.4g} Hz only (valid_hz)"


def _guessed(channel: Channel, frequency_hz: float) -> list[str]:
    return [] if channel.is_known(frequency_hz) else [f"the plant at {frequency_hz:.4g} Hz"]


def whole_verdict(controller: Controller, display: Display | None = None, drawn: Sequence[DrawnPlants] = ()) -> Verdict:
    """Return the verdict on the objectives and on building an image, for `display` (None: the controller's own), and on
    the plants `drawn` for it, if any.
    """
    judged = judge(controller, display)
    shown = controller if display is None else replace(controller, display=display)
    findings = [finding for objective in judged.objectives for finding in objective.findings]
    findings += judge_drawn(drawn, shown.display)
    return verdict_of([*findings, buildable(shown)], (*judged.assumptions, *drawn_assumptions(drawn)))


MAY_PASS, CONFIDENCE = 0.05, 0.95
"""Share of plants that may pass a limit, and the confidence with which that is told."""
_UNSTABLE = "unstable loops"


def judge_drawn(drawn: Sequence[DrawnPlants], display: Display) -> list[Finding]:
    """Return the findings on plants drawn for `display`'s channels: stability and max|S| (iii), flatness without load
    (i), felt hum (ii)."""
    return [finding for one in drawn for finding in _findings(one, display.channel(one.channel), display)]


def drawn_assumptions(drawn: Sequence[DrawnPlants]) -> tuple[str, ...]:
    """Return what the draws assume, one sentence each."""
    shifts = {one.channel: one.mode_shift for one in drawn if one.mode_shift > 0.0}
    return tuple(
        f"modes of {name}: {100.0 * shift:g} % of standard deviation in frequency (--mode-shift)"
        for name, shift in shifts.items()
    )


def _findings(one: DrawnPlants, channel: Channel, display: Display) -> Iterator[Finding]:
    asked = display.objectives
    if np.any(np.isfinite(one.sensitivity_peak)) or one.unstable > 0.0:
        yield _judged(one, "iii", _UNSTABLE, np.where(one.stable, 0.0, 100.0), 0.0, "%")
        peak = channel.feedback.sensitivity_peak
        if peak is not None:
            yield _judged(one, "iii", "max|S|", one.sensitivity_peak, peak, "")
    if one.load == UNLOADED:
        found = _judged(one, "i", "error of |H|", one.flatness_db + channel.model_error_db, asked.flatness_db, "dB")
        found = unsure(found, channel) if channel.model_error_db > 0.0 else found
        yield _open(found, "the plant is not known over the whole band (valid_hz)") if _is_beyond(channel) else found
    if np.any(np.isfinite(one.felt_hum_db_sl)):
        hum = _judged(one, "ii", "felt hum", one.felt_hum_db_sl, asked.mains_max_db_sl, "dB SL")
        assumed = [what for what in ("hum", "friction") if what in channel.environment.assumed]
        yield _open(hum, rests_on(" and ".join(assumed))) if assumed else hum


def _judged(one: DrawnPlants, objective: str, quantity: str, values: FloatArray, allowed: float, unit: str) -> Finding:
    """Return the finding that no more than `MAY_PASS` of the plants pass `allowed`."""
    passing = int(np.sum(~(values <= allowed)))
    few = float(special.bdtr(passing, one.count, MAY_PASS)) <= 1.0 - CONFIDENCE
    many = passing > 0 and float(special.bdtrc(passing - 1, one.count, MAY_PASS)) <= 1.0 - CONFIDENCE
    if quantity == _UNSTABLE:
        few, many = few and passing == 0, passing > 0
    outcome = Outcome.MET if few else Outcome.NOT_MET if many else Outcome.NOT_JUDGED
    share = f"{passing} of {one.count} plants drawn from the {one.source} pass it"
    remarks = {
        Outcome.MET: share,
        Outcome.NOT_MET: f"{share}; more reserve in [feedback], or a plant that is better known",
        Outcome.NOT_JUDGED: f"{share}: too few to tell whether 5 % do; more plants (--monte-carlo)",
    }
    if quantity == _UNSTABLE:
        value = 100.0 * one.unstable
    else:
        value = float(np.quantile(np.where(np.isfinite(values), values, np.inf), 1.0 - MAY_PASS, method="higher"))
    named = quantity if quantity == _UNSTABLE else f"{quantity}, 95 % of plants"
    found = Finding(
        objective, one.channel, one.load, outcome, named, value if np.isfinite(value) else None, allowed, unit,
        remark=remarks[outcome],
    )  # fmt: skip
    if one.source == "nominal":
        return _open(found, "nothing tells how the plant may differ; a model by `identify`, a covariance or a family")
    return found


def _open(found: Finding, why: str) -> Finding:
    return replace(found, outcome=Outcome.NOT_JUDGED, remark=why)


def _is_beyond(channel: Channel) -> bool:
    """Tell whether the band reaches beyond the frequencies at which the plant is known."""
    return not all(channel.is_known(edge) for edge in channel.threshold.band_hz)

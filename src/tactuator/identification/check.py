"""Records made ready for identification: samples of unit size, what they show by themselves, and what they excite."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, within
from tactuator.identification.data import Signals
from tactuator.identification.lines import HIGHEST, Spectrum
from tactuator.identification.options import IdentifyOptions
from tactuator.identification.trust import AGAINST, BAND_DB, BAND_DEG, CLIPPED, COHERENT, INTEGRATOR
from tactuator.model.plant_model import PlantModel, QualityCheck
from tactuator.model.plausibility import EXPECTED, Doubt, record_doubts, swing
from tactuator.signals.record import Record
from tactuator.signals.spectra import mean_over_frequency

FEWEST = 100
"""Samples below which nothing is identified."""
_LEVELS, _FEW_LEVELS = 10_000, 50
"""Parts of its span in which a signal's levels are counted, and the count below which it is meant to have few."""
_FEW_BANDS = 6
"""Coherent bands below which a slope and a lag are not judged."""


def check_record(record: Record, where: str = "") -> tuple[QualityCheck, ...]:
    """Return what decides on a record by itself; BadInput where it cannot be used at all."""
    if record.command.size < FEWEST:
        raise BadInput(f"the record has {record.command.size} samples", f"{FEWEST} or more")
    for name in ("command", "position"):
        values = getattr(record, name)
        if np.ptp(values) <= 1e-12 * max(float(np.max(np.abs(values))), 1e-300):
            raise BadInput(f"the {name} is constant ({values[0]:g})", "one that moves")
    clipped = clipped_share(record.position)
    if clipped > 0.2:
        raise BadInput(f"{100.0 * clipped:.0f} % of the position is clipped", "20 % at most")
    return (CLIPPED.of(100.0 * clipped, where),) if clipped > 0.0 else ()


def clipped_share(values: FloatArray) -> float:
    """Return the share of samples that sit at an extreme in runs, as a saturated converter leaves them; 0 for a signal
    of few levels (steps, a binary sequence), which is meant to sit there.
    """
    span = float(np.ptp(values))
    levels = np.bincount(np.rint((values - values.min()) * (_LEVELS / span)).astype(np.int64))
    if np.count_nonzero(levels) < _FEW_LEVELS:
        return 0.0
    total = 0
    for extreme, sign in ((values.max(), 1.0), (values.min(), -1.0)):
        at = sign * (extreme - values) <= 1e-9 * span
        near = (sign * (extreme - values) <= 0.01 * span) & ~at
        edges = np.flatnonzero(np.diff(np.concatenate([[0], at.astype(np.int8), [0]])))
        runs = edges[1::2] - edges[::2]
        long = int(runs[runs >= 3].sum())
        if long >= 6 and long > near.sum():
            total += long
        # share of samples exactly at an extreme from which on it is a limit, though none lasts
        elif at.sum() > max(6, 0.005 * values.size, 3.0 * near.sum()):
            # a quick signal comes back from its limit after a sample or two
            total += int(at.sum())
    return total / values.size


def check_direction(response: EmpiricalResponse) -> tuple[Doubt, ...]:
    """Check whether the position follows the command: a mechanism falls with frequency, and lags."""
    coherent = response.surely()
    if coherent.frequency_hz.size < _FEW_BANDS:
        return ()
    log_f = np.log(coherent.frequency_hz)
    upper = log_f >= np.median(log_f)
    slope = np.polyfit(log_f[upper], np.log(np.abs(coherent.value[upper])), 1)[0]
    phase = np.unwrap(np.angle(coherent.value))
    rises = slope > 1.0 and phase[-1] > phase[0] - 0.2
    return tuple(EXPECTED["lead"].doubts(float(np.mean(phase[upper])))) if rises else ()


def check_rise(response: EmpiricalResponse) -> tuple[Doubt, ...]:
    """Check whether the phase rises over the band, as that of a mechanism's inverse does."""
    phase = np.unwrap(np.angle(response.surely().value))
    few = phase.size // 4
    if phase.size < _FEW_BANDS:
        return ()
    return tuple(EXPECTED["rise"].doubts(float(np.median(phase[-few:]) - np.median(phase[:few]))))


def check_polarity(num: FloatArray, den: FloatArray) -> tuple[QualityCheck, ...]:
    """Return what is open where the position goes against where the command pushes; num, den: descending powers."""
    lowest = num[np.flatnonzero(num)[-1]] if np.any(num) else 1.0
    against = lowest / (den[-1] if den[-1] != 0.0 else 1.0) < 0.0 and np.all(np.roots(den).real <= 0.0)
    return (AGAINST.of(1.0, "a polarity or the columns may be swapped"),) if against else ()


def check_length(
    poles_rad_s: NDArray[np.inexact[Any]], slow_error: float, duration_s: float
) -> tuple[QualityCheck, ...]:
    """Return what decides on the record's length, and refuse one shorter than the slowest time constant, unless the
    mechanism integrates.

    slow_error: standard error of the slowest pole, rad/s. A pole that cannot be distinguished from zero in a record 20
    times as long as the next time constant is an integrator; in a shorter one nothing is known of it.
    """
    # a resonance shows itself within its periods, however slowly it decays
    resonant = np.abs(poles_rad_s.imag) > np.abs(poles_rad_s.real)
    speed = np.sort(np.where(resonant, np.abs(poles_rad_s), np.abs(poles_rad_s.real)))
    slowest = float(speed[0])
    # within three time constants a pole must also exceed its uncertainty
    stands_out = slowest >= 3.0 * slow_error and bool(np.all(poles_rad_s.real <= 0.0))
    if slowest * duration_s >= 3.0 or (slowest * duration_s >= 1.0 and stands_out):
        return ()
    next_one = float(speed[1]) if speed.size > 1 else np.inf
    integrates = next_one * duration_s >= 20.0 and slowest < max(3.0 * slow_error, 0.1 / duration_s)
    if integrates:
        return (INTEGRATOR.of(slowest * duration_s, "a pole or an integrator"),)
    raise BadInput(
        f"the record lasts {duration_s:.3g} s, the slowest time constant {1.0 / max(slowest, 1e-300):.3g} s",
        "a longer record, or `order` with the number of poles that you expect",
    )


@dataclass(frozen=True)
class EmpiricalResponse:
    """Response y/u in bands: frequency (hertz), complex value, its relative standard error; all of shape (m,).

    excitation: the share of the command's power in each band; lines: those in it that the window leaves independent.
    Measured under feedback and noise it is biased towards the inverse of the feedback; it serves to start from, not to
    report.
    """

    frequency_hz: FloatArray
    value: NDArray[np.complex128]
    relative_error: FloatArray
    coherence: FloatArray
    excitation: FloatArray
    lines: FloatArray

    @property
    def clearest(self) -> float:
        """Return the coherence that the most coherent band surely has."""
        return float(np.max(self._least_coherence, initial=0.0))

    @property
    def _least_coherence(self) -> FloatArray:
        """Return the coherence of each band, four standard errors lower (Fisher's transform)."""
        sure = np.arctanh(np.sqrt(self.coherence)) - 4.0 / np.sqrt(2.0 * self.lines)
        return np.asarray(np.tanh(np.maximum(sure, 0.0)) ** 2)

    def surely(self) -> EmpiricalResponse:
        """Return the bands that are surely coherent: there may be none."""
        return self._bands(self._least_coherence >= COHERENT.limit)

    def trusted(self, coherence: float = 0.3, fewest: int = 8) -> EmpiricalResponse:
        """Return the bands of at least that coherence, or the `fewest` most coherent ones."""
        bound = min(coherence, float(np.sort(self.coherence)[-min(fewest, self.coherence.size)]))
        return self._bands(self.coherence >= bound)

    def _bands(self, keep: NDArray[np.bool_]) -> EmpiricalResponse:
        return EmpiricalResponse(*(getattr(self, item.name)[keep] for item in fields(self)))


def empirical_response(command: FloatArray, position: FloatArray, rate_hz: float) -> EmpiricalResponse:
    """Return the response in bands even in log frequency, 20 to a decade, from 3 lines above zero up to 0.45 rate, 5
    lines each at least.

    command, position: (n,). One Hann window over the whole record keeps its full resolution; the end-to-end slope is
    taken off first, as a drift would leak into every band.
    """
    count = command.size
    window = np.hanning(count)
    u, y = np.fft.rfft([window * _levelled(values) for values in (command, position)])
    spacing = rate_hz / count
    last, places = min(max(int(0.45 * rate_hz / spacing), 12), u.size - 1), [3]
    while places[-1] < last:
        places.append(max(places[-1] + 5, round(places[-1] * 10.0**0.05)))
    edges = np.minimum(np.array(places, dtype=np.int64), last)
    index = edges[:-1]
    suu = np.add.reduceat(np.abs(u) ** 2, edges)[:-1]
    syy = np.add.reduceat(np.abs(y) ** 2, edges)[:-1]
    syu = np.add.reduceat(y * np.conj(u), edges)[:-1]
    lines = np.arange(u.size) * spacing
    centre = np.add.reduceat(np.abs(u) ** 2 * lines, edges)[:-1] / np.maximum(suu, 1e-300)
    concentration = np.add.reduceat(np.abs(u) ** 4, edges)[:-1] / np.maximum(suu, 1e-300) ** 2
    effective = np.maximum(1.0 / np.maximum(concentration, 1e-12) / 1.9, 1.2)
    counted = np.maximum(np.diff(edges) / 1.9, 1.0)
    keep = (suu > 1e-14 * suu.max()) & (np.diff(edges) > 0) & (index > 0)
    coherence = np.clip(np.abs(syu) ** 2 / np.maximum(suu * syy, 1e-300), 1e-6, 1.0 - 1e-9)
    error = np.sqrt((1.0 - coherence) / coherence / (2.0 * effective))
    columns = (centre, syu / np.maximum(suu, 1e-300), error, coherence, suu / suu.sum(), counted)
    return EmpiricalResponse(*(values[keep] for values in columns))


def _levelled(values: FloatArray) -> FloatArray:
    """Take off mean and slope by least squares."""
    time = np.linspace(-1.0, 1.0, values.size)
    centred: FloatArray = values - values.mean()
    return np.asarray(centred - time * float(time @ centred) / float(time @ time))


@dataclass(frozen=True)
class ExcitationReport:
    """A command's excitation. order: lines of the command's two-sided spectrum, and so the number of parameters it can
    determine (Ljung, System Identification, 1999, section 13.2). needed: parameters of the model. low_hz, high_hz: of
    99.8 % of the power.
    """

    order: int
    needed: int
    low_hz: float
    high_hz: float

    @property
    def sufficient(self) -> bool:
        """Return whether there are enough lines for the parameters."""
        return self.order >= self.needed


def excitation_report(command: FloatArray, rate_hz: float, needed: int) -> ExcitationReport:
    """Return how many independent parameters `command` (n,) can determine."""
    centred = command - command.mean()
    turn = np.linspace(-np.pi, np.pi, command.size)
    # parts of the window's cosines: its side lobes are 92 dB down (Harris, On the use of windows, 1978)
    window = sum(part * np.cos(k * turn) for k, part in enumerate((0.35875, 0.48829, 0.14128, 0.01168)))
    power = np.abs(np.fft.rfft(window * centred)) ** 2
    power[:4] = 0.0
    strongest = float(power.max(initial=0.0))
    if not strongest > 1e-24 * command.size**2 * max(float(np.max(np.abs(command))), 1e-300) ** 2:
        return ExcitationReport(0, needed, 0.0, 0.0)
    # power of a line, over the strongest, below which it does not count: 80 dB
    above = np.concatenate([[False], power > 1e-8 * strongest, [False]]).astype(np.int8)
    edges = np.flatnonzero(np.diff(above))
    lengths = edges[1::2] - edges[::2]
    # the window spreads one line over about eight bins
    order = int(2 * np.sum(np.maximum(1, lengths - 8)))
    share = np.cumsum(power) / power.sum()
    frequency = np.arange(power.size) * rate_hz / command.size
    low, high = np.searchsorted(share, [0.001, 0.999])
    return ExcitationReport(order, needed, float(frequency[low]), float(frequency[min(high, power.size - 1)]))


def require_excitation(report: ExcitationReport) -> None:
    """Refuse to identify what was not excited."""
    if not report.sufficient:
        raise BadInput(
            f"the command excites order {report.order}, the model has {report.needed} parameters",
            f"a command of order {report.needed} or more (steps, noise, several sinusoids)",
        )


_SHARE, _FEWEST, _POINTS = 0.02, 12, 200
"""Width of the mean power over the frequency, lines in it at least, and frequencies at which it is looked at."""


def valid_range(
    model: PlantModel, moved_hz: tuple[float, float], widest_deg: float = BAND_DEG.limit
) -> tuple[float, float]:
    """Return the longest range within moved_hz over which the band of the model is narrow, Hz; a range of two
    neighbouring frequencies counts as none.
    """
    low, high = moved_hz
    frequency = np.geomspace(low, max(high, 1.01 * low), _POINTS)
    widest_rad = np.radians(widest_deg)
    narrow = np.flatnonzero((model.band_db(frequency) <= BAND_DB.limit) & (model.band_rad(frequency) <= widest_rad))
    if not narrow.size:
        return (float(frequency[0]), float(frequency[1]))
    # the longest run without a wide place in it
    runs = np.split(narrow, np.flatnonzero(np.diff(narrow) > 1) + 1)
    longest = max(runs, key=len)
    first, last = int(longest[0]), int(longest[-1])
    if first == last:
        first, last = min(first, _POINTS - 2), min(first, _POINTS - 2) + 1
    return (float(frequency[first]), float(frequency[last]))


def moved_range(spectra: Sequence[Spectrum]) -> tuple[float, float]:
    """Return the lowest and the highest frequency at which the commands of the records have power, Hz.

    The lines are those of a Hann window: those of the record as it is hold the jump between its ends too, which falls
    by only 20 dB a decade and moves nothing.
    """
    longest = max(spectra, key=lambda taken: taken.samples)
    count = longest.samples // 2
    frequency = np.geomspace(longest.spacing_hz, HIGHEST * longest.rate_hz, max(_POINTS, min(count, 2000)))
    power = np.max([_windowed(taken, frequency) for taken in spectra], axis=0)
    # power of the command, over its greatest, from which on it moves the mechanism (50 dB)
    moved = frequency[power > 1e-5 * float(np.max(power))]
    return (float(moved[0]), float(moved[-1]))


def _windowed(taken: Spectrum, frequency_hz: FloatArray) -> FloatArray:
    """Return the mean power of the command's windowed lines about each frequency (m,), 2 % of it or 12 lines wide."""
    lines = taken.command.copy()
    lines[0] = 0.0
    power = np.zeros(lines.size)
    power[1:-1] = np.abs(0.5 * lines[1:-1] - 0.25 * (lines[:-2] + lines[2:])) ** 2 / 0.375
    return mean_over_frequency(power, taken.frequency_hz, frequency_hz, 0.5 * _SHARE, _FEWEST)


@dataclass(frozen=True, eq=False)
class Prepared:
    """Records of one mechanism, the liveliest first, and their signals in one unit size (scale: of command and
    position); the first one's own response and excitation; what is asked; what decides on them; what was done to them.
    """

    records: tuple[Record, ...]
    signals: Signals
    scale: tuple[float, float]
    response: EmpiricalResponse
    excitation: ExcitationReport
    options: IdentifyOptions
    checks: tuple[QualityCheck, ...]
    remarks: tuple[str, ...]

    @property
    def in_loop(self) -> bool | None:
        """Return whether a loop is known to have been closed, None if nobody says so."""
        stated = {"yes": True, "no": False}.get(self.options.closed_loop)
        return True if stated is None and self.references is not None else stated

    @property
    def rate_hz(self) -> float:
        """Return the sampling rate, the same for all."""
        return self.records[0].rate_hz

    @property
    def gain(self) -> float:
        """Return the position's unit over the command's, as the samples were scaled."""
        return self.scale[1] / self.scale[0]

    @property
    def references(self) -> list[FloatArray] | None:
        """Return the loop's reference, (n,), of every record; None if one has none."""
        references = [record.reference for record in self.records if record.reference is not None]
        return references if len(references) == len(self.records) else None

    def place(self, record: int, sample: int) -> str:
        """Return in words where in the whole record, of several in which one, a sample lies."""
        of = self.records[record]
        file = f" in {of.about.get('file', 'one of the records')}" if len(self.records) > 1 else ""
        return f"at {of.from_s + sample / of.rate_hz:.6g} s{file}"

    @property
    def own_response(self) -> EmpiricalResponse:
        """Return the first record's own response in its units."""
        return replace(self.response, value=self.response.value * self.gain)

    @property
    def longest_s(self) -> float:
        """Return the duration of the longest record."""
        return max(record.duration_s for record in self.records)

    def model(self, num: FloatArray, den: FloatArray, covariance: FloatArray, **more: Any) -> PlantModel:
        """Return a model with its origin and what is asked of it; its band is 0.4 .. 300 Hz as far as
        the record reaches, or all that it reaches where that is less than a decade.
        """
        record, about = self.records[0], more.pop("record", {})
        lowest, highest = 1.0 / record.duration_s, 0.45 * record.rate_hz
        low, high = max(0.4, lowest), min(300.0, highest)
        whole = {"delay_s": 0.0, "quantity": self.options.quantity} | more
        # a display's figures are compared with these
        figures = {"rate_hz": record.rate_hz, "duration_s": record.duration_s}
        figures |= {f"{name}_half_span": swing(getattr(record, name)) for name in ("command", "position")}
        return PlantModel(
            num=num,
            den=den,
            covariance=covariance,
            band_hz=(low, high) if high >= 10.0 * low else (lowest, highest),
            command_unit=record.command_unit,
            position_unit=record.position_unit,
            record=record.about | figures | about,
            trust=self.checks,
            **whole,
        )


def check(parts: Sequence[Record], options: IdentifyOptions, remarks: Sequence[str] = ()) -> Prepared:
    """Return the aligned records made ready. Raises BadInput for those that cannot be used, or not together."""
    checks = list[QualityCheck]()
    for k, part in enumerate(parts):
        where = () if len(parts) == 1 else (f"record {k + 1}",)
        with within(*where):
            checks += check_record(part, *where)
    _require_alike(parts)
    command_unit, position_unit = (
        float(np.sqrt(np.mean([np.var(getattr(part, name)) for part in parts]))) for name in ("command", "position")
    )
    signals = [
        ((part.command - part.command.mean()) / command_unit, (part.position - part.position.mean()) / position_unit)
        for part in parts
    ]
    rate_hz = parts[0].rate_hz
    reports = [excitation_report(command, rate_hz, (options.order or 2) + 1) for command, _ in signals]
    liveliest = max(range(len(parts)), key=lambda k: (reports[k].order, parts[k].duration_s))
    require_excitation(reports[liveliest])
    response = empirical_response(*signals[liveliest], rate_hz)
    order = [liveliest, *(k for k in range(len(parts)) if k != liveliest)]
    cannot_be = (*(doubt for part in parts for doubt in record_doubts(part)), *check_direction(response))
    return Prepared(
        records=tuple(parts[k] for k in order),
        signals=[signals[k] for k in order],
        scale=(command_unit, position_unit),
        response=response,
        excitation=reports[liveliest],
        options=options,
        checks=(
            *checks,
            COHERENT.of(response.clearest, remedy=lasting(parts)),
            *(doubt.quality_check() for doubt in cannot_be),
        ),
        remarks=tuple(remarks),
    )


def lasting(records: Sequence[Record]) -> str:
    """Return in words how long the longest of the records is."""
    return f"in a record of {max(record.duration_s for record in records):.3g} s"


def _require_alike(records: Sequence[Record]) -> None:
    first = records[0]
    for k, other in enumerate(records[1:], start=2):
        if abs(other.rate_hz / first.rate_hz - 1.0) > 1e-6:
            raise BadInput(f"record {k} has {other.rate_hz:g} Hz, the first {first.rate_hz:g} Hz", "one rate")
        units = [(record.command_unit, record.position_unit) for record in (first, other)]
        if units[0] != units[1]:
            raise BadInput(f"record {k} is in {units[1]}, the first in {units[0]}", "the same units")
        holds = [record.about.get("hold") for record in (first, other)]
        if holds[0] != holds[1]:
            raise BadInput(f"record {k} says hold {holds[1]}, the first {holds[0]}", "the same")

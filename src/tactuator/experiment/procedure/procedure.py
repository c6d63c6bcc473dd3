"""Adaptive procedures: settings with a rule that places the next trial and learns its outcome, and practice as one.

The kinds that a protocol file may name are entry points of the group GROUP; the project's own are found there too.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from itertools import product
from typing import Any, ClassVar

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.entry_points import plugin, plugins
from tactuator.errors import BadInput
from tactuator.parameters import from_table, table
from tactuator.perception.curve import COMFORT_DB_SL, LOWEST_DB_SL
from tactuator.perception.psychometric import TARGET_3_DOWN_1_UP, weibull_rise

GROUP = "tactuator.procedures"
GUESS = 1.0 / 3.0
"""Probability of a right guess in three intervals, the paper's."""
_TYPICAL_TRIALS = 80.0
"""Trials of a run of unknown length."""
FEWEST_TRIALS = 5
"""Trials of a run below which nothing is said of its threshold."""
ATTENTIVE_LAPSE, USUAL_LAPSE = 0.02, 0.04
"""Lapse rates of an attentive person, and of one who is less so: no rule may settle where the latter never come."""
_POINT_DIGITS = 1e-3
"""Digits of a balance point, in percent, that its numerical solution leaves open."""
PEOPLE_DB = 10.0
"""Two standard deviations of people's thresholds about the display's curve, rounded: `normal_offset_db`, the tilt and
the wave of the normal curves in the prior of `curve`."""
START_ABOVE_DB = 20.0
"""Level of the first trial above the threshold that the experimenter expects, as in the paper."""


@dataclass(frozen=True)
class Placement:
    """Where a trial is put: level, dB SL of the display, and the frequency where the procedure chooses it."""

    level_db_sl: float
    frequency_hz: float | None = None


@dataclass(frozen=True)
class Estimate:
    """A threshold, dB SL of the display.

    standard_error_db: None where the procedure has none. reversal_spread_db: standard deviation of the levels that a
    track averages, which follow from each other: it is no error of their mean.
    """

    level_db_sl: float
    standard_error_db: float | None
    reversal_spread_db: float | None = None


@dataclass(frozen=True)
class Playable:
    """Range of stimuli that a display offers a procedure that chooses frequencies.

    band_hz: lowest and highest frequency. mains_hz: frequency whose multiples are avoided, 0 for none. clearance_hz:
    distance to keep from those multiples.
    """

    band_hz: tuple[float, float] = (0.4, 300.0)
    mains_hz: float = 60.0
    clearance_hz: float = 2.5


PLAYABLE = Playable()
"""What the paper's display plays."""


@table("[procedure]")
class Procedure:
    """Settings of one kind of procedure, the keys of its table [procedure], and its rule.

    A kind is an entry point of GROUP: its name is `kind` in the file, and it refers to a table that inherits from this
    one, with the kind's own keys, and `begin`.
    """

    chooses_frequency: ClassVar[bool] = False
    """Whether a run chooses the frequency of every trial, as a whole curve's does, so that the file lists none. Such a
    kind has `places` and `curve` as well."""
    scatter_db: ClassVar[float] = 0.0
    """Standard deviation of thresholds about the expected one, where runs are simulated."""
    runs_at_once: ClassVar[int] = 1024
    """Runs that are simulated side by side; limited by their memory."""

    _: KW_ONLY
    kind: str = ""

    @property
    def point(self) -> float:
        """Share correct, lapses included, at the level of the estimate."""
        return TARGET_3_DOWN_1_UP

    @property
    def typical_trials(self) -> float:
        """About how many trials a run has: its key `trials`, where it has one."""
        return float(getattr(self, "trials", _TYPICAL_TRIALS))

    @property
    def most_trials(self) -> float:
        """Return the number of trials after which every run is over: its key `trials`, or `trial_limit`."""
        return float(getattr(self, "trials", getattr(self, "trial_limit", np.inf)))

    @property
    def lowest_db_sl(self) -> float:
        """Return the lowest level that a run may reach: its key `floor_db_sl`, or `low_db_sl`."""
        return float(getattr(self, "floor_db_sl", getattr(self, "low_db_sl", LOWEST_DB_SL)))

    @property
    def highest_db_sl(self) -> float:
        """Return the highest level that a run may reach: its key `ceiling_db_sl`, or `high_db_sl`."""
        return float(getattr(self, "ceiling_db_sl", getattr(self, "high_db_sl", COMFORT_DB_SL)))

    def warnings(self) -> Iterator[str]:
        """Yield which end of the levels lies among people's thresholds, so that it bounds those of some."""
        if not any(self._out_of_reach(-PEOPLE_DB)):
            yield from self._out_of_reach(PEOPLE_DB)

    def _out_of_reach(self, spread_db: float) -> Iterator[str]:
        """Yield each end of the levels that does not reach so far beyond the expected threshold.

        A low first level makes nobody more sensitive: the highest level is to reach the display's curve in any case.
        """
        least, words = self.expected_threshold(), f"thresholds are expected at {{:g}} ± {PEOPLE_DB:g} dB; the"
        most = max(least, 0.0)
        if least - spread_db < self.lowest_db_sl:
            yield f"{words.format(least)} lowest level is {self.lowest_db_sl:g} dB"
        if most + spread_db > self.highest_db_sl:
            yield f"{words.format(most)} highest level is {self.highest_db_sl:g} dB"

    def faults(self, guess: float) -> Iterator[BadInput]:
        """Yield every reason why no run can reach a threshold, whatever the answers. guess: as `begin` takes it."""
        lowest, highest = 100.0 * guess, 100.0 * (1.0 - USUAL_LAPSE)
        if not lowest < 100.0 * self.point - _POINT_DIGITS < highest:
            allowed = f"above {lowest:.3g} %, which guesses reach, and below {highest:.3g} %, as people lapse"
            yield BadInput(f"{self.kind} that settles at {100.0 * self.point:.2f} % correct", allowed)
        if self.most_trials < FEWEST_TRIALS:
            yield BadInput(f"{self.kind} of {self.most_trials:g} trials at most", f"{FEWEST_TRIALS} or more")
        yield from map(BadInput, self._out_of_reach(-PEOPLE_DB))

    def begin(self, guess: float = GUESS, playable: Playable = PLAYABLE, count: int = 1) -> Runs:
        """Return so many fresh runs over what can be played. guess: probability of a right answer without feeling."""
        raise NotImplementedError

    def expected_threshold(self) -> float:
        """Return the threshold that an experimenter expects who chooses these settings, dB SL."""
        first = self.begin().placement()
        if first is None:
            raise BadInput("a procedure that has no trial", "one with at least one")
        return first.level_db_sl - START_ABOVE_DB

    def expecting(self, threshold_db_sl: float) -> Procedure:
        """Return the procedure as it is set where that threshold is expected: by default its key `start_db_sl`.

        Raises BadInput for a kind without that key.
        """
        if not hasattr(self, "start_db_sl"):
            raise BadInput(f"a start with {self.kind}", "a procedure with start_db_sl")
        return replace(self, start_db_sl=threshold_db_sl + START_ABOVE_DB)  # type: ignore[call-arg]

    def below(self, ceiling_db_sl: float) -> Procedure:
        """Return the procedure with no level above the ceiling, if it has levels."""
        return self

    def places(self, playable: Playable) -> FloatArray:
        """Return the frequencies at which trials may be put, (points,), where runs choose them."""
        raise NotImplementedError

    def curve(
        self,
        guess: float,
        playable: Playable,
        frequency_hz: FloatArray,
        level_db_sl: FloatArray,
        correct: NDArray[np.bool_],
    ) -> MeasuredCurve:
        """Return what trials of a run say, (trials,) each, as they were played, whatever placed them."""
        raise NotImplementedError


class Runs:
    """Runs of a procedure side by side, as a state machine; a session has one of them.

    The same outcomes in the same order always give the same placements, so that replaying a run's outcomes resumes it.
    A procedure's own runs have `level_db_sl` and `learn`. count: of the runs. trials: recorded so far, (count,).
    """

    frequency_hz: FloatArray | None = None
    """Frequency of the next trial of every run, (count,), where the procedure chooses it."""
    passed = True
    """False for practice that has not met its criterion."""

    def __init__(self, count: int, limit: int) -> None:
        self.count, self.limit = count, limit
        self.trials: NDArray[np.int64] = np.zeros(count, dtype=np.int64)

    @property
    def level_db_sl(self) -> FloatArray:
        """Level of the next trial of every run, (count,)."""
        raise NotImplementedError

    def learn(self, correct: NDArray[np.bool_]) -> None:
        """Learn the outcome of the next trial of every run, (count,); that of a run that is over means nothing."""
        raise NotImplementedError

    @property
    def over(self) -> NDArray[np.bool_]:
        """Whether each run is over, (count,)."""
        return np.asarray(self.trials >= self.limit)

    def placement(self, run: int = 0) -> Placement | None:
        """Return where the next trial of a run is put, or None when it is over."""
        if self.over[run]:
            return None
        hertz = self.frequency_hz
        return Placement(float(self.level_db_sl[run]), None if hertz is None else float(hertz[run]))

    def record(self, correct: ArrayLike) -> None:
        """Learn the outcome of every run's trial. Raises BadInput once all runs are over."""
        over = self.over
        if over.all():
            raise BadInput(f"the run was over after {self.trials.max()} trials", "no further response")
        self.learn(np.broadcast_to(np.asarray(correct, dtype=np.bool_), self.count))
        self.trials = self.trials + ~over

    def progress(self, run: int = 0) -> float:
        """Return how far a run is, from 0 to 1; it never falls."""
        return float(self.trials[run] / self.limit)

    def estimate(self, run: int = 0) -> Estimate | None:
        """Return the threshold as the procedure itself states it, or None while (or where) it has none."""
        return None

    def flags(self, run: int = 0) -> tuple[str, ...]:
        """Return the names of what a reader must know of a run: floor, ceiling, trial-limit."""
        return ()

    def picture(self) -> Mapping[str, object]:
        """Return what an operator's page draws of one run, in place of the track of its levels."""
        return {}


@dataclass(frozen=True)
class MeasuredCurve:
    """A curve by the trials of one run, at every frequency at which they may be put, (points,) each.

    mean, sd, low, high: dB SL, with the 95 % band. notch_trials: how many more about the point would exclude a notch.
    flags, drift_power: of the run.
    """

    frequency_hz: FloatArray
    mean: FloatArray
    sd: FloatArray
    low: FloatArray
    high: FloatArray
    notch_trials: NDArray[np.intp]
    flags: tuple[str, ...]
    drift_power: float


def procedure_kind(name: str) -> type[Procedure]:
    """Return a kind of procedure, of this package or another. Raises BadInput for a name nobody declares, and for one
    whose entry point refers to anything else."""
    kind = plugin(GROUP, name)
    if not (isinstance(kind, type) and issubclass(kind, Procedure)):
        raise BadInput(f"{name!r} refers to {kind!r}", "a table that inherits from Procedure", where=(GROUP,))
    return kind


def parse_procedure(document: Any) -> Procedure:
    """Return the procedure of a table [procedure]. Raises BadInput for an unknown kind, and for keys it refuses."""
    if isinstance(document, Procedure):
        return document
    kind = document.get("kind") if isinstance(document, Mapping) else None
    if not isinstance(kind, str) or kind not in plugins(GROUP):
        raise BadInput(repr(kind), ", ".join(plugins(GROUP)), key="kind")
    return from_table(procedure_kind(kind), document)


class Practice(Runs):
    """Practice of at most `limit` trials at one level, without an estimate.

    correct: number of right answers among the last `window` trials that passes practice and ends it; None: it is passed
    by doing all of its trials.
    """

    def __init__(self, level_db_sl: float, limit: int, window: int = 1, correct: int | None = None) -> None:
        super().__init__(1, limit)
        self._level, self._correct = np.array([level_db_sl]), correct
        self._last: deque[bool] = deque(maxlen=window)

    @property
    def level_db_sl(self) -> FloatArray:
        return self._level

    @property
    def passed(self) -> bool:  # type: ignore[override]
        """Whether the criterion is met, or, without a criterion, whether all trials are done."""
        return bool(self.trials[0] >= self.limit) if self._correct is None else sum(self._last) >= self._correct

    @property
    def over(self) -> NDArray[np.bool_]:
        return np.asarray((self.trials >= self.limit) | self.passed)

    def progress(self, run: int = 0) -> float:
        """Return the share of the trials done; with a criterion, the share of the fewest trials that can meet it."""
        if self._correct is None:
            return super().progress()
        return 1.0 if self.passed else min(int(self.trials[0]), self._correct) / (self._correct + 1)

    def learn(self, correct: NDArray[np.bool_]) -> None:
        self._last.append(bool(correct[0]))


_PROBABILITY_MARGIN = 1e-6
_WEIBULL_SPREAD_DB = float(np.pi / np.sqrt(6.0) * 20.0 / np.log(10.0))
"""Standard deviation over dB of a Weibull in amplitude of slope 1; it falls as the slope rises."""


def psi_at(level_db: FloatArray, slope: FloatArray, lapse: FloatArray, guess: float, target: float) -> FloatArray:
    """Return psi of Weibull in amplitude at levels re threshold, kept off 0 and 1; arrays broadcast."""
    rise = weibull_rise(level_db, slope, (target - guess) / (1.0 - guess - lapse))
    psi = guess + (1.0 - guess - lapse) * rise
    return np.asarray(np.clip(psi, _PROBABILITY_MARGIN, 1.0 - _PROBABILITY_MARGIN))


@dataclass(frozen=True)
class Answering:
    """Psychometric functions of a detection task that a procedure thinks possible, with their prior probabilities.

    slopes: of the Weibull in amplitude, equally probable. lapses, lapse_shares: lapse rates and their probabilities.
    guess: probability of a right guess. target: share correct at threshold, lapses included. normal_share: share of a
    cumulative normal over dB in the shape, the rest being the Weibull of the same spread: a run has too few trials to
    tell the two shapes apart, and people of either are read with half the bias. Raises BadInput unless 0 <= guess <
    target < 1 - lapse for every lapse.
    """

    slopes: tuple[float, ...] = (0.8, 1.4, 2.1, 3.2)
    lapses: tuple[float, ...] = (0.02, 0.1, 0.2)
    lapse_shares: tuple[float, ...] = (0.55, 0.3, 0.15)
    guess: float = GUESS
    target: float = TARGET_3_DOWN_1_UP
    normal_share: float = 0.0

    def __post_init__(self) -> None:
        if not self.slopes or min(self.slopes) <= 0.0 or len(self.lapses) != len(self.lapse_shares):
            raise BadInput("answering: slopes, lapses or shares", "positive slopes, a share for every lapse")
        if not 0.0 <= self.guess < self.target < 1.0 - max(self.lapses):
            raise BadInput(
                f"answering: guess {self.guess:g}, target {self.target:g}, lapses up to {max(self.lapses):g}",
                "0 <= guess < target < 1 - lapse",
            )

    @property
    def pairs(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return slope and lapse rate of every psychometric function, in the order of slopes, then lapses."""
        slopes, lapses = zip(*product(self.slopes, self.lapses), strict=True)
        return slopes, lapses

    def psi(self, level_db: FloatArray, slope: FloatArray, lapse: FloatArray) -> FloatArray:
        """Return the probability of a correct response at level_db relative to threshold; arguments broadcast."""
        psi = psi_at(level_db, slope, lapse, self.guess, self.target)
        if self.normal_share == 0.0:
            return psi
        height = 1.0 - self.guess - lapse
        deviate = scipy.special.ndtri((self.target - self.guess) / height) + level_db * slope / _WEIBULL_SPREAD_DB
        normal = self.guess + height * scipy.special.ndtr(deviate)
        return np.asarray(psi + self.normal_share * (normal - psi))

    def log_chance(self, correct: NDArray[np.bool_]) -> FloatArray:
        """Return the log probability of each answer if it was guessed."""
        return np.asarray(np.where(correct, np.log(self.guess), np.log1p(-self.guess)))

"""Subcommands of `experiment` on detection: enrol, correct, observe, thresholds, export, backup, simulate."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field
from getpass import getuser
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np

from tactuator import report
from tactuator.api.option import Argument, Option, option_of
from tactuator.api.parameters import (
    ControllerOption,
    DisplayOption,
    Figures,
    Lsl,
    Place,
    RigOption,
    Seed,
    chosen_controller,
    opened,
    paper_controller,
    paper_display,
)
from tactuator.api.progress import say, working
from tactuator.entry_points import plugins
from tactuator.errors import BadInput, given_as, unknown, within
from tactuator.experiment.export import export as exported
from tactuator.experiment.presenter import Outlet
from tactuator.experiment.procedure.procedure import GROUP, Playable
from tactuator.experiment.protocol.codes import doubts
from tactuator.experiment.protocol.file import read_protocol
from tactuator.experiment.protocol.study import StudyProtocol, SubjectPart
from tactuator.experiment.result.confusion import threshold_table
from tactuator.experiment.result.store_results import GroupCurve, StoreResults, store_results
from tactuator.experiment.result.thresholds import names_of_people
from tactuator.experiment.session.studies import (
    Correction,
    StudyRecords,
    fresh_token,
    open_study,
    study_records,
    task_of,
)
from tactuator.experiment.session.task import Apparatus, SessionTask, SystemClock
from tactuator.experiment.simulated.planning import PlannedStudy, StudyPlan
from tactuator.experiment.simulated.quality import CurveQuality, Setting, simulate_kind
from tactuator.experiment.simulated.subjects import run_study, simulated_observers, with_truths
from tactuator.experiment.store import records
from tactuator.experiment.store.erasure import erase as erase_subject
from tactuator.experiment.store.merging import copy_studies
from tactuator.experiment.store.store import Store, opened_store, sessions_of
from tactuator.experiment.store.voids import Part, set_void
from tactuator.experiment.words import shipped_words
from tactuator.io.csv_tables import read_relative_curve, write_curve
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.parameters import from_table
from tactuator.perception.curve import RelativeCurve
from tactuator.plain import finite
from tactuator.result import (
    Chart,
    ChartLine,
    Column,
    Fact,
    Result,
    ResultTable,
    data,
    found,
    rows_of,
)
from tactuator.rig.rig import Rig, require_finger_ports, usual_load
from tactuator.rig.simulated import PacedRig

ProtocolFile = Annotated[Place, Argument("Protocol file (TOML).", metavar="PROTOCOL", file=True)]
StoreFile = Annotated[Place, Option("Store of the experiment: a file (SQLite), or postgresql+pg8000://...", type=str)]
StudyName = Annotated[str | None, Option("Name of the study; default: the store's only one.")]
Code = Annotated[str, Argument("Code of the subject: letters and digits.", metavar="CODE")]
ParticipantId = Annotated[str | None, Option("The subject's name elsewhere.")]
OperatorName = Annotated[str | None, Option("Your name, for the log; default: your login name.")]
Voided = Annotated[bool, Option("Include what is void.")]
SkinTemperatureC = Annotated[float | None, Option("Skin temperature of the day, °C.")]


@contextmanager
def opened_apparatus(
    rig: Rig | str,
    display: Display | Place | None,
    controller: Controller | Place | None,
    seed: int,
    speed: float | None,
    lsl: bool = False,
) -> Iterator[Apparatus]:
    """Yield the rig with a controller loaded, open for the length of the context and left at rest.

    Without a display or controller: the paper's display and C. speed: of presentation on a rig that could go faster,
    None: as fast as it can. lsl: with an outlet. Raises BadInput for a speed that is none, and as `chosen_controller`,
    `open_rig` and `Outlet` do.
    """
    if speed is not None and not speed > 0.0:
        raise BadInput(f"speed {speed:g}", "a positive number, 1 being real time")
    paper = display is None and controller is None
    loaded = paper_controller(paper_display()) if paper else chosen_controller(display, controller)
    with opened(rig, loaded.display, seed) as ready:
        ready.load(loaded)
        played, name = ready if speed is None else PacedRig(ready, speed), rig if isinstance(rig, str) else "simulated"
        if not lsl:
            yield Apparatus(played, loaded, name)
            return
        with closing(Outlet(played, name, loaded.display.name)) as outlet:
            yield Apparatus(played, loaded, name, outlet)


@dataclass(frozen=True, eq=False, repr=False)
class CheckedProtocol(Result):
    """Whether a study can come to results at a display: every reason why it cannot, and what else it warns of."""

    study: str
    asks: str
    runs: int
    minutes: float
    faults: tuple[BadInput, ...]
    warnings: tuple[str, ...]

    @property
    def holds(self) -> bool:
        return not self.faults

    def notices(self) -> Sequence[str]:
        return [f"warning: {warning}" for warning in self.warnings]

    def facts(self) -> Sequence[Fact]:
        return [
            Fact("study", self.study, "study", summary=True),
            Fact("asks", self.asks, "what is asked", summary=True),
            Fact("runs", self.runs, "runs of a visit", summary=True),
            Fact("minutes", self.minutes, "a visit plays about", "min", ".0f", summary=True),
            Fact("holds", self.holds, "can come to results", summary=True),
            *(found("it cannot", str(fault)) for fault in self.faults),
            *data({"faults": [fault.document() for fault in self.faults], "warnings": list(self.warnings)}),
        ]


def check_protocol(
    protocol: ProtocolFile,
    rig: RigOption = "simulated",
    display: DisplayOption = None,
    controller: ControllerOption = None,
) -> CheckedProtocol:
    """Check whether a study can come to results. Its rules must settle above chance and at levels that the display
    plays, its practice must end, and its subjects' facts must be there; `serve` refuses a study that cannot.
    """
    with opened_apparatus(rig, display, controller, 0, None) as place:
        study, text = read_protocol(Path(protocol), StudyProtocol)
        task = task_of(study, Path(protocol).parent, place)
        expected = [task.expected(run) for run in task.runs(0)]
        faults = (*task.faults(), *study.missing_facts()) or _refused(task, text)
    minutes = sum(trials * played_s for trials, played_s in expected) / 60.0
    return CheckedProtocol(study.study.name, study.asks, len(expected), minutes, faults, tuple(study.warnings()))


def _refused(task: SessionTask, text: str) -> tuple[BadInput, ...]:
    """Return why a new store refuses the study, if it does."""
    with TemporaryDirectory() as folder, closing(Store(Path(folder) / "new.db", durable=False)) as store:
        try:
            open_study(store, task, text, SystemClock(), fresh_token)
        except BadInput as error:
            return (error,)
    return ()


@dataclass(frozen=True, eq=False, repr=False)
class EnrolledResult(Result):
    """A subject of a study, and the links of all visits by the visit's number."""

    study: str
    subject: str
    visits: Mapping[int, str]
    warnings: tuple[str, ...] = ()

    def notices(self) -> Sequence[str]:
        return [f"warning: {warning}" for warning in self.warnings]

    def facts(self) -> Sequence[Fact]:
        visits = [{"visit": visit, "path": path} for visit, path in self.visits.items()]
        return [
            Fact("study", self.study, "study", summary=True),
            Fact("subject", self.subject, "subject", summary=True),
            Fact("visits", visits),
            Fact("warnings", list(self.warnings)),
            *(found(f"visit {visit}, link after the server's address", path) for visit, path in self.visits.items()),
        ]


def enrol(
    code: Code,
    store: StoreFile,
    study: StudyName = None,
    group: Annotated[str | None, Option("Any name, as hearing or neuropathy (default: unknown).")] = None,
    participant_id: ParticipantId = None,
    skin_temperature_c: SkinTemperatureC = None,
    fact: Annotated[list[str] | None, Option("An item of [[demographic]].", metavar="NAME=VALUE")] = None,
    visit: Annotated[bool, Option("A further visit of a subject who is enrolled.")] = False,
    operator: OperatorName = None,
) -> EnrolledResult:
    """Add a subject, or a further visit of one. The links of all visits are shown."""
    if visit and any(value is not None for value in (group, participant_id, skin_temperature_c, fact or None)):
        raise BadInput("`visit` with facts of a new subject", "`visit` alone, for a subject who is enrolled")
    with _opened_study(store, study, operator) as opened:
        if visit:
            opened.add_visit(code)
        else:
            opened.enrol(_part(code, group, participant_id, skin_temperature_c, fact or []))
        known = records.sessions(opened.connection, opened.id)
    facts, codes = dict(_pairs("fact", "NAME=VALUE", fact or [])), {row.subject_code for row in known}
    said = () if visit else _doubts([code, group, participant_id], codes, facts, opened.protocol)
    links = {row.visit: f"/s/{row.link_token}" for row in known if row.subject_code == code}
    return EnrolledResult(opened.protocol.study.name, code, links, said)


@dataclass(frozen=True, eq=False, repr=False)
class CorrectedResult(Result):
    """What was corrected of a subject: item, value before and value after of each change; warnings: what other programs
    make of the new values."""

    study: str
    subject: str
    changes: tuple[Mapping[str, Any], ...]
    warnings: tuple[str, ...] = ()

    def notices(self) -> Sequence[str]:
        return [f"warning: {warning}" for warning in self.warnings]

    def facts(self) -> Sequence[Fact]:
        changes = [(each["item"], each["before"] or "-", each["after"] or "-") for each in self.changes]
        return [
            Fact("study", self.study, "study", summary=True),
            Fact("subject", self.subject, "subject", summary=True),
            Fact("changes", self.changes),
            *(found(str(item), f"{after} (before: {before})") for item, before, after in changes),
        ]


def correct(
    code: Code,
    store: StoreFile,
    reason: Annotated[str, Option("Why; logged with the old value.")],
    study: StudyName = None,
    group: Annotated[str | None, Option("Any name, as hearing or neuropathy.")] = None,
    participant_id: ParticipantId = None,
    visit: Annotated[int | None, Option("Which visit; default: the only one.")] = None,
    skin_temperature_c: SkinTemperatureC = None,
    preload_n: Annotated[float | None, Option("Contact force of the day, N.")] = None,
    fact: Annotated[
        list[str] | None, Option("An item of [[demographic]]; NAME= removes it.", metavar="NAME=VALUE")
    ] = None,
    operator: OperatorName = None,
) -> CorrectedResult:
    """Correct the data of a subject or a visit. The old value stays in the store and in exports."""
    part = _part(code, group, participant_id, skin_temperature_c, [])
    if preload_n is not None and not 0.0 <= preload_n < float("inf"):
        raise BadInput(f"{preload_n:g}", "a number of 0 or more", where=("subject",), key="preload_n")
    facts = dict(_pairs("fact", "NAME=VALUE", fact or [], empty=True))
    values = (None if group is None else part.group, part.participant_id, facts)
    correction = Correction(*values, visit, part.skin_temperature_c, preload_n)
    with _opened_study(store, study, operator) as opened:
        changes = opened.correct(code, correction, reason)
    said = _doubts([group, participant_id], [], facts, opened.protocol)
    return CorrectedResult(opened.protocol.study.name, code, tuple(map(asdict, changes)), said)


def _doubts(
    names: Sequence[str | None], codes: Iterable[str], facts: Mapping[str, str], protocol: StudyProtocol
) -> tuple[str, ...]:
    """Return what other programs make of codes and other names, beside these codes, and of facts."""
    words, others = shipped_words("en"), list(codes)
    of_names = (doubt for name in names if name is not None for doubt in doubts(name, others, words))
    return *of_names, *protocol.doubtful_facts(facts, words)


@dataclass(frozen=True, eq=False, repr=False)
class RenamedResult(Result):
    """A subject with another code; warnings: what other programs make of it."""

    study: str
    before: str
    subject: str
    warnings: tuple[str, ...] = ()

    def notices(self) -> Sequence[str]:
        return [f"warning: {warning}" for warning in self.warnings]


def rename(
    code: Code,
    new: Annotated[str, Argument("The new code.", metavar="NEW")],
    store: StoreFile,
    reason: Annotated[str, Option("Why; logged with the old code.")],
    study: StudyName = None,
    operator: OperatorName = None,
) -> RenamedResult:
    """Give a subject another code. Links stay as they are; nobody else can get the old code."""
    with _opened_study(store, study, operator) as opened:
        opened.rename(code, new, reason)
        others = [row.code for row in records.subjects(opened.connection, opened.id)]
    said = tuple(doubts(new, others, shipped_words("en")))
    return RenamedResult(opened.protocol.study.name, code, new, said)


@dataclass(frozen=True, eq=False, repr=False)
class VoidResult(Result):
    """What is void now, or valid again: a visit of a subject, a run of it, or a trial of the run."""

    study: str
    subject: str
    visit: int
    run: int | None
    trial: int | None
    void: bool


def void(
    code: Code,
    store: StoreFile,
    reason: Annotated[str, Option("Why; logged, and exported with --voided.")],
    visit: Annotated[int | None, Option("Which visit; default: the only one, or the run's.")] = None,
    run: Annotated[int | None, Option("Only this run, by its number in exports.")] = None,
    trial: Annotated[int | None, Option("Only this trial of the run, by its number in exports.")] = None,
    restore: Annotated[bool, Option("Take it in again.")] = False,
    study: StudyName = None,
    operator: OperatorName = None,
) -> VoidResult:
    """Leave a visit, run or trial out of all results. It stays in the store."""
    with _opened_study(store, study, operator) as opened:
        about = (code, Part(visit, run, trial), not restore, reason, opened.now, opened.who)
        part = set_void(opened.connection, opened.id, *about)
    assert part.visit is not None
    return VoidResult(opened.protocol.study.name, code, part.visit, run, trial, not restore)


@dataclass(frozen=True, eq=False, repr=False)
class ErasedResult(Result):
    """How much was erased of a subject, and what is left to do where the program does not reach."""

    study: str
    visits: int
    runs: int
    trials: int
    is_file: bool
    names: tuple[str, ...] = field(repr=False)

    def notices(self) -> Sequence[str]:
        server = [] if self.is_file else ["the server keeps deleted rows until VACUUM FULL, and in its own logs"]
        return [
            *server,
            "erase the subject from the protocol file, exports and backups, too; they are not known here: search for "
            + ", ".join(map(repr, self.names)),
            "what is noted of others (reasons, facts, values of the protocol) may still describe the subject",
        ]


def erase(
    store: Annotated[Place, Argument("Store of the experiment.", metavar="STORE", type=str)],
    code: Code,
    study: StudyName = None,
    operator: OperatorName = None,
) -> ErasedResult:
    """Erase everything of a subject from a store. An event says that it was done and how much, without a name."""
    with sessions_of(store), opened_store(store, must_exist=True) as database:
        database.compact()  # refused while another program reads, before anything is gone
        with database.begin() as connection:
            opened = study_records(connection, study, fresh_token, SystemClock().utc(), operator or getuser())
            erased = erase_subject(connection, opened.id, code, opened.now, opened.who)
        database.compact()
        return ErasedResult(opened.protocol.study.name, **vars(erased), is_file=database.is_file)


@contextmanager
def _opened_study(store: Place, study: str | None, operator: str | None) -> Iterator[StudyRecords]:
    with sessions_of(store), opened_store(store, must_exist=True) as database, database.begin() as connection:
        yield study_records(connection, study, fresh_token, SystemClock().utc(), operator or getuser())


def _part(
    code: str, group: str | None, participant_id: str | None, skin_temperature_c: float | None, facts: list[str]
) -> SubjectPart:
    """Return the subject as a protocol file would have it. Raises BadInput for what one may not hold."""
    document = {
        "code": code,
        "group": group or "unknown",
        "participant_id": participant_id,
        "skin_temperature_c": skin_temperature_c,
        "demographics": dict(_pairs("fact", "NAME=VALUE", facts)),
    }
    return from_table(SubjectPart, document, "subject")


def _pairs(option: str, form: str, texts: Sequence[str], empty: bool = False) -> list[tuple[str, str]]:
    """Return (name, value) of each text of the form NAME=VALUE, or, where `empty` is allowed, NAME=.

    Raises BadInput for another form, or a name twice.
    """
    pairs = []
    for text in texts:
        code, equals, value = text.partition("=")
        if not (code and equals and (value or empty)):
            raise BadInput(f"`{option}` {text!r}", form)
        pairs.append((code, value))
    if len({code for code, _ in pairs}) != len(pairs):
        name = form.partition("=")[0].lower()
        raise BadInput(f"`{option}` twice for a {name}", f"each {name} once")
    return pairs


@dataclass(frozen=True, eq=False, repr=False)
class ObservedResult(Result):
    """Simulated subjects who answered: subject, frequency (Hz), what is true there; none: nothing was left to do."""

    store: Place
    truth: tuple[tuple[str, float, float], ...]

    def table(self) -> Sequence[Column]:
        return [
            Column("subject", [subject for subject, _, _ in self.truth], "simulated subject"),
            Column("frequency_hz", [hertz for _, hertz, _ in self.truth], "frequency (Hz)"),
            Column("true_db_re_1um", [level for _, _, level in self.truth], "true threshold (dB re 1 µm)", ".1f"),
            Column("simulated", ["simulated"] * len(self.truth)),
        ]

    def facts(self) -> Sequence[Fact]:
        subjects = dict.fromkeys(subject for subject, *_ in self.truth)
        answered = ", ".join(subjects) or "nothing left to do, all have gone through the study"
        return [
            Fact("store", self.store, "store", summary=True),
            Fact("truth", rows_of(self.table())),
            found("simulated subjects", f"{answered} (nobody felt this)"),
        ]

    def next_step(self) -> str:
        return f"tactuator experiment thresholds --store {self.store}"


def observe(
    protocol: ProtocolFile,
    store: StoreFile,
    rig: RigOption = "simulated",
    display: DisplayOption = None,
    controller: ControllerOption = None,
    load: Annotated[
        str | None, Option("Load while a finger is there, or none (default: finger, or the first).")
    ] = None,
    truth: Annotated[
        list[str] | None, Option("A subject's threshold (frequency_hz,level_db_sl).", metavar="SUBJECT=CSV")
    ] = None,
    lapse: Annotated[list[str] | None, Option("A subject's lapse rate.", metavar="SUBJECT=RATE")] = None,
    lsl: Lsl = False,
    seed: Annotated[int, Option("Seed of rig and people; [study] seed draws their answers.", ge=0)] = 0,
) -> ObservedResult:
    """Run simulated subjects through a study. Detection or strength, on a simulated display. With `lsl` they wait for a
    recorder.

    >>> tt.observe("small.toml", "observed.db", seed=1).store
    'observed.db'
    """
    study, text = read_protocol(Path(protocol), StudyProtocol)
    with within(f"protocol {protocol}"):
        study.require_observers()
    codes, seen = [subject.code for subject in study.subject], set[int]()
    files, lapses = _pairs("truth", "SUBJECT=CSV", truth or []), _lapses(lapse or [])
    with sessions_of(store), opened_apparatus(rig, display, controller, seed, None, lsl) as place:
        truths = {code: _truth(path, place.band_hz) for code, path in files}
        _make_ready(place, study.warning)
        channels = place.controller.display.channels
        curve, touching = channels[0].threshold.curve, load or usual_load(channels)
        observers = with_truths(
            simulated_observers(curve, len(codes), seed, place.band_hz), codes, curve, truths, lapses
        )
        with working("people", 1000 * len(codes)) as step, opened_store(store) as database:

            def show(at: int, share: float) -> None:
                seen.add(at)
                step(round(1000 * (at + share)))

            finger = None if touching == "none" else touching
            run_study(database, study, text, place, observers, SystemClock(), finger, show)
    hertz = np.array(study.frequencies_hz or np.geomspace(*place.band_hz, 12).round(3))
    each = [(codes[at], observers[at].curve.level_db_re_1um_at(hertz)) for at in sorted(seen)]
    rows = [(code, float(at), float(level)) for code, of in each for at, level in zip(hertz, of, strict=True)]
    return ObservedResult(store, tuple(rows))


def _truth(path: Place, band_hz: tuple[float, float]) -> RelativeCurve:
    """Return a person's threshold from a CSV; report where it is extended to cover the band."""
    curve = read_relative_curve(Path(path))
    (low_hz, high_hz), (lowest_hz, highest_hz) = curve.frequency_hz[[0, -1]], band_hz
    if lowest_hz < low_hz or high_hz < highest_hz:
        band = f"{low_hz:g} to {high_hz:g} Hz of {lowest_hz:g} to {highest_hz:g} Hz"
        say(f"{path} covers {band}: beyond, the level at its end is taken")
    return curve


def _make_ready(place: Apparatus, warning: str) -> None:
    """Print the warning; wait for a recorder, if requested. Raises BadInput for a rig without finger ports."""
    require_finger_ports(place.rig, place.name)
    if warning:
        say(warning)
    if place.outlet is not None:
        say("waiting for a recorder of the streams tactuator-markers and tactuator-levels")
        place.outlet.wait_for_recorder()


def _lapses(texts: Sequence[str]) -> dict[str, float]:
    lapses = {}
    for code, text in _pairs("lapse", "SUBJECT=RATE", texts):
        try:
            lapses[code] = float(text)
        except ValueError:
            raise BadInput(f"`lapse` {code}={text}", "SUBJECT=RATE with a number") from None
    return lapses


@dataclass(frozen=True, eq=False, repr=False)
class StoreThresholds(Result):
    """Thresholds of a store's finished runs, and the curve across subjects; not_written: why its
    file was not."""

    results: StoreResults
    not_written: BadInput | None = None

    @property
    def ending(self) -> BaseException | None:
        """Return why there is no curve, if one was requested; the thresholds are printed all the same."""
        return self.not_written

    def facts(self) -> Sequence[Fact]:
        thresholds, group = self.results.thresholds, self.results.group
        levels = [threshold.refit_db_sl for threshold in thresholds]
        flagged = sum(bool(threshold.flags) for threshold in thresholds)
        return [
            found("runs", len({threshold.run for threshold in thresholds})),
            found("subjects", len(self.results.people)),
            found("thresholds", f"{' to '.join(dict.fromkeys(f'{end(levels):.1f}' for end in (min, max)))} dB SL"),
            *([found("doubtful (flagged)", flagged)] if flagged else []),
            *([found("runs without a threshold", without)] if (without := len(self.results.not_refitted)) else []),
            *([] if group is None else [found("curve across subjects", group.curve.provenance)]),
            *([found("simulated", "nobody felt this")] if self._simulated else []),
            *data(self.results.document()),
        ]

    def notices(self) -> Sequence[str]:
        by_reason: dict[str, list[str]] = {}
        for run, reason in self.results.not_refitted:
            by_reason.setdefault(reason, []).append(str(run.run.id))
        return [f"no threshold of run {', '.join(ids)}: {reason}" for reason, ids in by_reason.items()]

    @property
    def _simulated(self) -> bool:
        return any(each.simulated for each in self.results.thresholds)

    def table(self) -> Sequence[Column]:
        thresholds = self.results.thresholds
        names = ("subject", "finger", "frequency_hz", "refit_db_sl", "refit_low_db_sl", "refit_high_db_sl", "trials")
        return [
            *(Column(name, [getattr(threshold, name) for threshold in thresholds]) for name in names),
            Column("flags", [", ".join(threshold.flags) for threshold in thresholds]),
            Column("simulated", ["simulated" if threshold.simulated else "" for threshold in thresholds]),
        ]

    def chart(self) -> Chart:
        curves = []
        for person, name in names_of_people(self.results.thresholds).items():
            of = [each for each in self.results.thresholds if (each.study_number, each.subject) == person]
            hertz, level, low, high = (
                np.array([getattr(threshold, key) for threshold in of])
                for key in ("frequency_hz", "refit_db_sl", "refit_low_db_sl", "refit_high_db_sl")
            )
            half = np.nan_to_num(np.maximum([level - low, high - level], 0.0), posinf=_OPEN_DB)
            curves.append(ChartLine(f"{name}, ± 95 %", hertz, level, "o", half, [bool(t.flags) for t in of]))
        curve = self.results.reference.name
        limits = {f"curve {curve!r}": 0.0}
        axes = ("frequency (Hz)", "threshold (dB SL)")
        return Chart(*axes, curves, log_x=True, limits=limits, simulated=self._simulated)

    def tables(self) -> Sequence[ResultTable | str]:
        measured = threshold_table(self.results.thresholds, shipped_words("en"))
        curve = [] if self.results.group is None else [self._curve(self.results.group)]
        return [measured, *curve, *([self._not_known()] if self.results.not_known else [])]

    def _not_known(self) -> ResultTable:
        """Return the frequencies at which people lie beyond what was played on both sides."""
        rows = tuple(
            (f"{hertz:.4g}", f"{row.low_db:.1f} to {row.high_db:.1f}", f"{row.people} ({row.censored})")
            for hertz, row in self.results.not_known.items()
        )
        columns = ("Hz", "dB re 1 µm", "people (beyond what was played)")
        return ResultTable("mean across subjects not known from either side", columns, rows)

    def _curve(self, group: GroupCurve) -> ResultTable:
        """Return the curve across subjects as a table, beside it the one with, or without, doubtful thresholds."""
        beside = self.results.beside
        drawn = [group, *([] if beside is None else [beside])]
        columns = ["Hz", "dB re 1 µm", "people (beyond what was played)"]
        if beside is not None:
            columns += [self.results.beside_is, "people"]
        rows = []
        for hertz, count in zip(group.curve.frequency_hz, group.subjects, strict=True):
            if count:
                cells_of = [_point(curve, float(hertz)) for curve in drawn]
                rows.append((f"{hertz:.4g}", *(cell for cells in cells_of for cell in cells)))
        left_out = dict.fromkeys(f"{each.subject}, run {each.run}" for each in group.left_out)
        notes = [f"left out: {'; '.join(left_out)}"] if left_out else []
        unknown = zip(group.unknown, group.curve.frequency_hz, strict=True)
        where = [f"{count} at {hertz:.4g} Hz" for count, hertz in unknown if count]
        notes += [f"not counted, known from neither side: {', '.join(where)}"] if where else []
        if beside is not None:
            notes.append("a flag alone leaves nobody out: decide, and say `leave_out` CODE or `leave_out` flagged")
        return ResultTable(
            f"curve across subjects ({group.curve.provenance})", tuple(columns), tuple(rows), tuple(notes)
        )


_OPEN_DB = 100.0
"""Length of a bar whose end is open: it leaves the axes."""


def _point(group: GroupCurve, hertz: float) -> tuple[str, str]:
    at = [index for index, f in enumerate(group.curve.frequency_hz) if f == hertz and group.subjects[index]]
    if not at or group.curve.standard_error_db is None:
        return "–", "–"
    level, error = group.curve.level_db_re_1um[at[0]], group.curve.standard_error_db[at[0]]
    sign = {"": "", ">=": "≥ ", "<=": "≤ "}[group.bound[at[0]]]
    beyond = f" ({group.censored[at[0]]})" if group.censored[at[0]] else ""
    spread = "" if sign else f" ± {error:.1f}"
    return f"{sign}{level:.1f}{spread}", f"{group.subjects[at[0]]}{beyond}"


def thresholds(
    store: StoreFile,
    group: Annotated[str | None, Option("Only subjects of this group.")] = None,
    reference: Annotated[str | None, Option("Curve (name or CSV) to which dB SL referred.")] = None,
    curve_out: Annotated[
        Place | None, Option("Write the curve across subjects (CSV) for `design`.", writes="curve")
    ] = None,
    figures: Figures = None,
    leave_out: Annotated[
        list[str] | None, Option("Subject to leave out of the curve, or flagged: all doubtful thresholds.")
    ] = None,
    voided: Voided = False,
) -> StoreThresholds:
    """Refit thresholds of every finished run. Gives flags, and the curve across subjects.

    The curve has all subjects that are not left out; the curve without doubtful thresholds is beside it.
    Raises BadInput where there are no such runs, or runs on several curves without a reference.

    >>> tt.thresholds("lab.db").headline()["subjects"]
    '1'
    """
    with working("refitting the runs"):
        results = store_results(store, group, reference, leave_out or [], voided)
    refused = None if curve_out is None else results.no_curve
    if results.group is not None and curve_out is not None:
        try:
            write_curve(Path(curve_out), results.group.curve, results.circumstances)
        except BadInput as error:
            refused = error
    if figures is not None:
        names = [report.felt_figures.psychometric_name(person.name) for person in results.people]
        report.figure.save_figures(_figures(results), Path(figures), ["fig11", *names])
    return StoreThresholds(results, refused)


_PEOPLE_DRAWN = 100
"""Subjects whose psychometric functions are drawn: each takes a fifth of a second."""


def _figures(results: StoreResults) -> Iterator["report.figure.ReportFigure"]:
    """Yield the figures of a store, each drawn when it is asked for."""
    new = None if results.group is None else results.group.curve
    others = {} if results.beside is None else {results.beside_is: results.beside.curve}
    yield report.felt_figures.thresholds_figure(results.people, results.reference, new, others)
    if (count := len(results.people)) > _PEOPLE_DRAWN:
        say(f"psychometric functions of {_PEOPLE_DRAWN} of {count} subjects are drawn; choose a group for others")
    for name, runs in islice(results.psychometric(), _PEOPLE_DRAWN):
        yield report.felt_figures.psychometric_figure(name, runs)


@dataclass(frozen=True, eq=False, repr=False)
class ExportedResult(Result):
    """A folder with every answered trial of a store."""

    folder: Path
    format: str
    trials: int


def export(
    store: StoreFile,
    out: Annotated[Place, Option("Folder to write.", writes="folder")],
    form: Annotated[str, Option("Format: tidy, psych-ds or bids.", ("--format",))] = "tidy",
    voided: Voided = False,
) -> ExportedResult:
    """Write every answered trial in an open format. The folder also has a data dictionary."""
    with working("exporting"), closing(Store(store, must_exist=True, voided=voided)) as database:
        return ExportedResult(Path(out), form, exported(database, Path(out), form))


@dataclass(frozen=True, eq=False, repr=False)
class BackupResult(Result):
    """A whole copy of a store; answers: their number in it."""

    out: Path
    answers: int


def backup(
    store: Annotated[Place, Argument("Store of the experiment: a file (SQLite).", metavar="STORE", type=str)],
    out: Annotated[Place, Argument("File to write.", metavar="OUT", writes="store")],
) -> BackupResult:
    """Copy a store whole, also while it is served.

    Raises BadInput where the place cannot be written.
    """
    with closing(Store(store, must_exist=True, whole=False)) as database:
        return BackupResult(Path(out), database.backup(Path(out)))


@dataclass(frozen=True, eq=False, repr=False)
class MergedResult(Result):
    """A new store with the studies of others."""

    out: Path
    stores: int


def merge(
    stores: Annotated[Sequence[Place], Argument("Stores to copy.", file=True, type=list[Path])],
    out: Annotated[Place, Option("Store to write: a new file.", writes="store")],
) -> MergedResult:
    """Copy several stores into a new one. Their studies stay apart, also those of one name.

    Raises BadInput where the file is there, and for stores with the same visits.
    """
    if Path(out).exists():
        raise BadInput(f"{out} exists", "a new file")
    with opened_store(out) as merged, merged.begin() as target:
        for store in stores:
            with within(f"{store}"), closing(Store(store, must_exist=True)) as database, database.read() as source:
                copy_studies(source, target)
    return MergedResult(Path(out), len(stores))


@dataclass(frozen=True, eq=False, repr=False)
class QualityResult(Result):
    """How good a procedure is. figures: bias, spread and the rest, by name. study, plan: what is to be found with it,
    and what that takes.
    """

    procedure: str
    runs: int
    figures: Mapping[str, Any]
    study: PlannedStudy | None = None
    plan: StudyPlan | None = None

    def facts(self) -> Sequence[Fact]:
        rows = [("procedure", f"{self.procedure}, {self.runs} simulated runs")]
        for key, value in self.figures.items():
            if isinstance(value, dict):
                rows += [_quality_row(f"{key} {inner}", number) for inner, number in value.items()]
            elif key != "by_frequency":
                rows.append(_quality_row(key, value))
        facts = [Fact("", text, words, summary=words in _SUMMARISED) for words, text in rows]
        if self.study is not None and self.plan is not None:
            groups = " in each of two groups" if self.study.design == "between" else ""
            facts += [
                found("error of a person's threshold", self.plan.error_db, "dB", ".2f"),
                found("subjects", f"{self.plan.subjects}{groups}"),
                found("power", f"{self.plan.power:.3f} for {self.study.effect_db:g} dB"),
                *data({"study": finite(self.study), "plan": finite(self.plan)}),
            ]
        return [*facts, *data(self.figures), Fact("simulated", True)]

    def table(self) -> Sequence[Column]:
        rows = self.figures.get("by_frequency", ())
        return [
            Column("frequency_hz", [row["frequency_hz"] for row in rows], "frequency (Hz)"),
            Column("rms_error_db", [row["rms_error_db"] for row in rows], "rms error (dB)", ".2f"),
            Column("coverage95", [row["coverage95"] for row in rows], _WORDS["coverage95"], ".2f"),
        ]


_SUMMARISED = (
    *("procedure", "refit: bias (dB)", "refit: rms error (dB)", "rms error of the median person (dB)"),
    *("trials, mean", "runs that did not end"),
)
"""Figures of a procedure that the summary has."""
_WORDS = {
    "sd": "standard deviation", "rmse": "rms error", "rms error median": "rms error of the median person",
    "trials mean": "trials, mean", "trials p05": "trials, 5th percentile", "trials p95": "trials, 95th percentile",
    "coverage95": "share inside the 95 % interval", "unfinished": "runs that did not end",
    "flagged": "share of runs that are flagged", "notch excluded": "share of points without an unseen notch",
}  # fmt: skip


def _quality_row(key: str, value: object) -> tuple[str, str]:
    name = key.removesuffix("_db").replace("_", " ")
    last = name.removeprefix("refit ")
    words = f"refit: {_WORDS.get(last, last)}" if last != name else _WORDS.get(name, name)
    if key.endswith("_db"):
        return f"{words} (dB)", f"{value:.2f}"
    digits = 0 if words.startswith("trials") else 2
    return words, f"{value:.{digits}f}" if isinstance(value, float) else str(value)


def simulate(
    procedure: Annotated[
        str,
        Option("Procedure: imece2004, up-down, quest-plus, curve, or another package's."),
    ] = "imece2004",
    runs: Annotated[int, Option("Simulated runs.")] = 1000,
    slope: Annotated[str, Option("Weibull slope, or LOW:HIGH to draw each run's from.")] = "2.5",
    lapse: Annotated[float, Option("Lapse rate.")] = Setting.lapse,
    start_db: Annotated[float, Option("Start, dB above the true threshold.")] = Setting.start_db,
    trials: Annotated[int | None, Option("Trials of a run, where the procedure has a number of them.")] = None,
    truth: Annotated[
        Place | None,
        Option("Of curve: the threshold, a CSV with frequency_hz,level_db_sl (default: drawn).", file=True),
    ] = None,
    guess: Annotated[float, Option("Share of trials that are guessed; 1: all.")] = Setting.guessed,
    drift_db: Annotated[float, Option("Rise of thresholds over the run, dB.")] = Setting.drift_db,
    loud_share: Annotated[float, Option("Share of loud catch trials, as in [catch].")] = Setting.loud_share,
    effect_db: Annotated[float | None, Option("Difference to find, dB.")] = None,
    spread_db: Annotated[float | None, option_of(PlannedStudy, "spread_db")] = None,
    design: Annotated[str, option_of(PlannedStudy, "design")] = PlannedStudy.design,
    repeats: Annotated[int, option_of(PlannedStudy, "repeats")] = PlannedStudy.repeats,
    alpha: Annotated[float, option_of(PlannedStudy, "alpha")] = PlannedStudy.alpha,
    power: Annotated[float, option_of(PlannedStudy, "power")] = PlannedStudy.power,
    seed: Seed = 0,
) -> QualityResult:
    """Assess how accurate a procedure's estimates are. Runs it with many simulated people. With `effect_db` and
    `spread_db`: how many subjects a study needs, and its power.

    Raises BadInput for an effect without a spread, and where no number of subjects finds it.

    >>> tt.simulate("quest-plus", runs=20, seed=1).runs
    20
    """
    if procedure not in plugins(GROUP):
        raise unknown("procedure", procedure, plugins(GROUP))
    if (effect_db is None) != (spread_db is None):
        raise BadInput("one of `effect_db` and `spread_db`", "both, or neither: no spread is assumed")
    study = None
    if effect_db is not None and spread_db is not None:
        study = PlannedStudy(effect_db, spread_db, design, repeats, alpha, power)  # type: ignore[arg-type]
    with given_as("guessed", "guess"):
        setting = Setting(runs, _slope_range(slope), lapse, start_db, seed, guess, drift_db, loud_share)
    people = None if truth is None else _truth(truth, Playable.band_hz)
    with working(f"{runs} runs", 1.0) as step:
        quality = simulate_kind(procedure, setting, trials, people, step)
    error_db = quality.rms_error_db if isinstance(quality, CurveQuality) else quality.refit.rmse_db
    figures = finite(quality)
    assert isinstance(figures, dict)
    return QualityResult(procedure, runs, figures, study, None if study is None else study.plan(error_db))


def _slope_range(text: str) -> tuple[float, float]:
    low, _, high = text.partition(":")
    try:
        return float(low), float(high or low)
    except ValueError:
        raise BadInput(f"slope {text!r}", "a number, or LOW:HIGH") from None

"""The parts of the verb `experiment` on detection: enrol, correct, observe, thresholds, export, simulate."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tactuator.errors import BadInput
from tactuator.table import Chart, ChartLine, ResultTable
from tactuator.verbs.chosen import opened_apparatus
from tactuator.verbs.declared import Fields
from tactuator.verbs.parameters import (
    Argument,
    ControllerOption,
    DisplayOption,
    Figures,
    Option,
    Place,
    RigOption,
    Seed,
)
from tactuator.verbs.progress import working
from tactuator.verbs.result import Result, columns_of, plain

if TYPE_CHECKING:
    from tactuator.experiment.protocol.study import SubjectPart
    from tactuator.experiment.result.store_results import StoreResults

_SETTING = Fields("experiment.simulated.quality:Setting")

ProtocolFile = Annotated[Place, Argument("Protocol file (TOML).", metavar="PROTOCOL", file=True)]
StoreFile = Annotated[Place, Option("Database of the experiment (SQLite).", file=True)]
StoreToFill = Annotated[Place, Option("Database of the experiment (SQLite).", type=Path)]
StudyName = Annotated[str | None, Option("Name of the study; default: the store's only one.")]
Code = Annotated[str, Argument("Code of the subject: letters and digits.", metavar="CODE")]
ParticipantId = Annotated[str | None, Option("The subject's name elsewhere.")]
SkinTemperatureC = Annotated[float | None, Option("Skin temperature of the day, °C.")]


@dataclass(frozen=True, eq=False, repr=False)
class EnrolledResult(Result):
    """A subject of a study, and the links of all visits by the visit's number."""

    study: str
    subject: str
    visits: Mapping[int, str]

    def to_dict(self) -> dict[str, Any]:
        visits = [{"visit": visit, "path": path} for visit, path in self.visits.items()]
        return {"study": self.study, "subject": self.subject, "visits": visits}

    def tables(self) -> Sequence[ResultTable | str]:
        rows = tuple((str(visit), path) for visit, path in self.visits.items())
        return [ResultTable(f"{self.study}: {self.subject}", ("visit", "link, after the server's address"), rows)]


def enrol(
    code: Code,
    store: StoreFile,
    study: StudyName = None,
    group: Annotated[str | None, Option("hearing, hearing-impaired, simulated or unknown (the default).")] = None,
    participant_id: ParticipantId = None,
    skin_temperature_c: SkinTemperatureC = None,
    fact: Annotated[list[str] | None, Option("An item of [[demographic]]; repeatable.", metavar="NAME=VALUE")] = None,
    visit: Annotated[bool, Option("A further visit of a subject who is enrolled.")] = False,
) -> EnrolledResult:
    """Add a subject, or a further visit of one. The links of all visits are shown."""
    from tactuator.experiment.session.studies import add_visit, books_of, fresh_token
    from tactuator.experiment.session.studies import enrol as enrol_subject
    from tactuator.experiment.session.task import SystemClock
    from tactuator.experiment.store import records
    from tactuator.experiment.store.store import Store, sessions_of

    if visit and any(value is not None for value in (group, participant_id, skin_temperature_c, fact or None)):
        raise BadInput("--visit with facts of a new subject", "--visit alone, for a subject who is enrolled")
    path = Path(store)
    with closing(Store(path, must_exist=True)) as database, sessions_of(path), database.begin() as connection:
        books = books_of(connection, study, fresh_token, SystemClock().utc())
        if visit:
            add_visit(connection, books, code)
        else:
            enrol_subject(connection, books, _part(code, group, participant_id, skin_temperature_c, fact or []))
        rows = [row for row in records.sessions(connection, books.study) if row.subject_code == code]
    return EnrolledResult(books.protocol.study.name, code, {row.visit: f"/s/{row.link_token}" for row in rows})


@dataclass(frozen=True, eq=False, repr=False)
class CorrectedResult(Result):
    """What was corrected of a subject: item, value before and value after of each change."""

    study: str
    subject: str
    changes: tuple[Mapping[str, Any], ...]

    def tables(self) -> Sequence[ResultTable | str]:
        rows = tuple(
            (str(change["item"]), *(change[at] or "-" for at in ("before", "after"))) for change in self.changes
        )
        return [ResultTable(f"{self.study}: {self.subject}", ("item", "before", "after"), rows)]


def correct(
    code: Code,
    store: StoreFile,
    reason: Annotated[str, Option("Why: it is kept with what stood there before.")],
    study: StudyName = None,
    group: Annotated[str | None, Option("hearing, hearing-impaired, simulated or unknown.")] = None,
    participant_id: ParticipantId = None,
    visit: Annotated[int | None, Option("Visit of the data of the day; default: the only one.")] = None,
    skin_temperature_c: SkinTemperatureC = None,
    preload_n: Annotated[float | None, Option("Contact force of the day, N.")] = None,
    fact: Annotated[
        list[str] | None, Option("An item of [[demographic]]; NAME= takes it away.", metavar="NAME=VALUE")
    ] = None,
) -> CorrectedResult:
    """Write correct data of a subject or a visit. What stood there stays in the store and in exports."""
    from tactuator.experiment.session.studies import Correction, books_of, fresh_token
    from tactuator.experiment.session.studies import correct as correct_subject
    from tactuator.experiment.session.task import SystemClock
    from tactuator.experiment.store.store import Store, sessions_of

    part = _part(code, group, participant_id, skin_temperature_c, [])
    if preload_n is not None and not 0.0 <= preload_n < float("inf"):
        raise BadInput(f"{preload_n:g}", "a number of 0 or more", where=("subject",), key="preload_n")
    facts = dict(_pairs("--fact", "NAME=VALUE", fact or [], empty=True))
    values = (None if group is None else part.group, part.participant_id, facts)
    correction = Correction(*values, visit, part.skin_temperature_c, preload_n)
    path = Path(store)
    with closing(Store(path, must_exist=True)) as database, sessions_of(path), database.begin() as connection:
        books = books_of(connection, study, fresh_token, SystemClock().utc())
        changes = correct_subject(connection, books, code, correction, reason)
    return CorrectedResult(books.protocol.study.name, code, tuple(map(asdict, changes)))


def _part(
    code: str, group: str | None, participant_id: str | None, skin_temperature_c: float | None, facts: list[str]
) -> "SubjectPart":
    """Return the subject as a protocol file would have it. Raises BadInput for what one may not hold."""
    from tactuator.experiment.protocol.study import SubjectPart
    from tactuator.parameters import from_table

    document = {
        "code": code,
        "group": group or "unknown",
        "participant_id": participant_id,
        "skin_temperature_c": skin_temperature_c,
        "demographics": dict(_pairs("--fact", "NAME=VALUE", facts)),
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
            raise BadInput(f"{option} {text!r}", form)
        pairs.append((code, value))
    if len({code for code, _ in pairs}) != len(pairs):
        name = form.partition("=")[0].lower()
        raise BadInput(f"{option} twice for a {name}", f"each {name} once")
    return pairs


@dataclass(frozen=True, eq=False, repr=False)
class ObservedResult(Result):
    """Simulated subjects who went through a study: subject, frequency (Hz) and true threshold (dB re 1 µm)."""

    store: Path
    truth: tuple[tuple[str, float, float], ...]

    def columns(self) -> Mapping[str, Any]:
        return columns_of(("subject", "frequency_hz", "true_db_re_1um"), self.truth)

    def to_dict(self) -> dict[str, Any]:
        return {"store": self.store, "truth": [dict(zip(self.columns(), row, strict=True)) for row in self.truth]}

    def tables(self) -> Sequence[ResultTable | str]:
        rows = tuple((subject, f"{hertz:.4g}", f"{level:.1f}") for subject, hertz, level in self.truth)
        columns = ("subject", "frequency (Hz)", "true threshold (dB re 1 µm)")
        return [ResultTable("", columns, rows), f"written: {self.store}"]


def observe(
    protocol: ProtocolFile,
    store: StoreToFill,
    rig: RigOption = "simulated",
    display: DisplayOption = None,
    controller: ControllerOption = None,
    load: Annotated[
        str | None, Option("Load while a finger is there, or none (default: finger, or the first).")
    ] = None,
    truth: Annotated[
        list[str] | None, Option("A subject's threshold (frequency_hz,level_db_sl).", metavar="SUBJECT=CSV")
    ] = None,
    lapse: Annotated[list[str] | None, Option("A subject's lapse rate; repeatable.", metavar="SUBJECT=RATE")] = None,
    seed: Seed = 0,
) -> ObservedResult:
    """Let simulated subjects go through the study. They feel what the loop of the simulated display makes of it."""
    import numpy as np

    from tactuator.experiment.protocol.file import read_protocol
    from tactuator.experiment.session.task import SystemClock
    from tactuator.experiment.simulated.sitting import run_study, simulated_observers, with_truths
    from tactuator.experiment.store.store import opened_store, sessions_of
    from tactuator.io.csv_tables import read_relative_curve
    from tactuator.rig.rig import require_finger_ports, usual_load

    study, text = read_protocol(Path(protocol))
    codes = [subject.code for subject in study.subject]
    truths = {code: read_relative_curve(Path(path)) for code, path in _pairs("--truth", "SUBJECT=CSV", truth or [])}
    lapses = _lapses(lapse or [])
    with sessions_of(Path(store)), opened_apparatus(rig, display, controller, seed, None) as place:
        require_finger_ports(place.rig, place.name)
        curve = place.controller.display.channels[0].threshold.curve
        drawn = simulated_observers(curve, len(codes), seed, place.band_hz)
        observers = with_truths(drawn, codes, curve, truths, lapses)
        at = {observer.name: index for index, observer in enumerate(observers)}
        touching = load or usual_load(place.controller.display.channels)
        named = None if touching == "none" else touching
        with working("observers", 1000 * len(observers)) as step, opened_store(Path(store)) as database:

            def show(name: str, share: float) -> None:
                step(round(1000 * (at[name] + share)))

            run_study(database, study, text, place, observers, SystemClock(), named, show)
    frequencies_hz = study.conditions.frequencies_hz or np.geomspace(*place.band_hz, 12).round(3).tolist()
    rows = [
        (code, hertz, float(observer.curve.level_db_re_1um_at(hertz)))
        for code, observer in zip(codes, observers, strict=True)
        for hertz in frequencies_hz
    ]
    return ObservedResult(Path(store), tuple(rows))


def _lapses(texts: Sequence[str]) -> dict[str, float]:
    """Read lapse rates of SUBJECT=RATE; raises BadInput for what has another form."""
    lapses = {}
    for code, text in _pairs("--lapse", "SUBJECT=RATE", texts):
        try:
            lapses[code] = float(text)
        except ValueError:
            raise BadInput(f"--lapse {code}={text}", "SUBJECT=RATE with a number") from None
    return lapses


@dataclass(frozen=True, eq=False, repr=False)
class StoreThresholds(Result):
    """Thresholds of the finished runs of an experiment's store, and the curve across subjects.

    is_curve_asked: whether a file or figures of the curve were asked for.
    """

    results: "StoreResults"
    is_curve_asked: bool = False

    @property
    def ending(self) -> BaseException | None:
        """Return why there is no curve, where one was asked for: the thresholds are worth telling all the same."""
        return self.results.no_curve if self.is_curve_asked else None

    def headline(self) -> Mapping[str, str]:
        thresholds = self.results.thresholds
        levels = [threshold.refit_db_sl for threshold in thresholds]
        people = {threshold.subject for threshold in thresholds}
        figures = {"runs": str(len(levels)), "subjects": str(len(people))}
        figures["thresholds"] = f"{min(levels):.1f} to {max(levels):.1f} dB SL"
        simulated = {"simulated": "nobody felt this"} if any(each.simulated for each in thresholds) else {}
        return figures | simulated

    def columns(self) -> Mapping[str, Any]:
        thresholds = self.results.thresholds
        names = ("subject", "finger", "frequency_hz", "refit_db_sl", "refit_low_db_sl", "refit_high_db_sl", "trials")
        columns = {name: [getattr(threshold, name) for threshold in thresholds] for name in names}
        return columns | {"flags": [", ".join(threshold.flags) for threshold in thresholds]}

    def chart(self) -> Chart:
        import numpy as np

        curves = []
        for name in dict.fromkeys(threshold.subject for threshold in self.results.thresholds):
            of = [threshold for threshold in self.results.thresholds if threshold.subject == name]
            hertz, level, low, high = (
                np.array([getattr(threshold, key) for threshold in of])
                for key in ("frequency_hz", "refit_db_sl", "refit_low_db_sl", "refit_high_db_sl")
            )
            half = np.maximum([level - low, high - level], 0.0)
            curves.append(ChartLine(f"{name}, ± 95 %", hertz, level, "o", half, [bool(t.flags) for t in of]))
        curve = self.results.reference.name
        return Chart("frequency (Hz)", "threshold (dB SL)", curves, log_x=True, limits={f"curve {curve!r}": 0.0})

    def to_dict(self) -> dict[str, Any]:
        return self.results.document()

    def tables(self) -> Sequence[ResultTable | str]:
        from tactuator.experiment.language.words import shipped_words
        from tactuator.experiment.result.confusion import threshold_table

        return [threshold_table(self.results.thresholds, shipped_words("en")), *self._who()]

    def _who(self) -> list[str]:
        group = self.results.group
        if group is None:
            return []
        points = [(f, count) for f, count in zip(group.curve.frequency_hz, group.subjects, strict=True) if count]
        counts = {count for _, count in points}
        if len(counts) == 1:
            people = f"people: {counts.pop()} at each of {len(points)} frequencies"
        else:
            people = "people: " + ", ".join(f"{count} at {hertz:.4g} Hz" for hertz, count in points)
        return [
            f"curve across subjects ({group.curve.provenance}): {people}",
            *(
                f"left out: {each.subject}, {each.finger}, {each.frequency_hz:.4g} Hz, run {each.run}: "
                f"{', '.join(each.flags)}"
                for each in group.left_out
            ),
        ]


def thresholds(
    store: StoreFile,
    group: Annotated[str | None, Option("Only subjects of this group.")] = None,
    reference: Annotated[str | None, Option("Curve (name or CSV) that 0 dB SL stood for.")] = None,
    curve_out: Annotated[
        Place | None, Option("Write the curve across subjects (CSV) for `design`.", writes=True)
    ] = None,
    figures: Figures = None,
    keep_flagged: Annotated[bool, Option("Take flagged runs into the curve across subjects as well.")] = False,
) -> StoreThresholds:
    """Refit thresholds of every finished run. They come with flags, and with the curve across subjects.

    Raises BadInput where there are no such runs, or runs that stand on several curves and no reference.

    >>> tt.thresholds("lab.db").headline()["subjects"]
    '1'
    """
    from tactuator.experiment.result.store_results import store_results
    from tactuator.io.csv_tables import write_curve

    with working("refitting the runs"):
        results = store_results(Path(store), group, reference, keep_flagged)
    if results.group is not None and curve_out is not None:
        write_curve(Path(curve_out), results.group.curve, results.circumstances)
    if results.group is not None and figures is not None:
        from tactuator.report.felt import psychometric_plate, thresholds_plate

        folder = Path(figures)
        folder.mkdir(parents=True, exist_ok=True)
        thresholds_plate(results.people, results.reference, results.group.curve).save(folder)
        for subject, trials in results.psychometric.items():
            psychometric_plate(subject, trials).save(folder)
    return StoreThresholds(results, curve_out is not None or figures is not None)


@dataclass(frozen=True, eq=False, repr=False)
class ExportedResult(Result):
    """A folder with every answered trial of a store."""

    folder: Path
    format: str
    trials: int

    def tables(self) -> Sequence[ResultTable | str]:
        return [f"{self.trials} trials exported"]


def export(
    store: StoreFile,
    out: Annotated[Place, Option("File or folder to write.", writes=True)],
    form: Annotated[str, Option("tidy, psych-ds or bids.", ("--format",))] = "tidy",
) -> ExportedResult:
    """Write every answered trial in an open format. The folder has a data dictionary, too."""
    from tactuator.experiment.export.export import export as exported
    from tactuator.experiment.store.store import Store

    with working("exporting"), closing(Store(Path(store), must_exist=True)) as database:
        return ExportedResult(Path(out), form, exported(database, Path(out), form))


@dataclass(frozen=True, eq=False, repr=False)
class QualityResult(Result):
    """How good a procedure is. figures: bias, spread and the rest, by name."""

    procedure: str
    runs: int
    figures: Mapping[str, Any]

    def headline(self) -> Mapping[str, str]:
        rows = []
        for key, value in self.figures.items():
            if isinstance(value, dict):
                rows += [_quality_row(f"{key} {inner}", number) for inner, number in value.items()]
            else:
                rows.append(_quality_row(key, value))
        return dict(rows)

    def to_dict(self) -> dict[str, Any]:
        return dict(self.figures)

    def tables(self) -> Sequence[ResultTable | str]:
        return [ResultTable(f"{self.procedure}, {self.runs} runs", ("figure", "value"), tuple(self.headline().items()))]


_WORDS = {
    "sd": "standard deviation", "rmse": "rms error", "rms error median": "rms error of the median person",
    "trials mean": "trials, mean", "trials p05": "trials, 5th percentile", "trials p95": "trials, 95th percentile",
    "coverage95": "share inside the 95 % interval", "unfinished": "runs that did not end",
    "flagged": "share of runs that are flagged",
}  # fmt: skip


def _quality_row(key: str, value: object) -> tuple[str, str]:
    """Return the words and the figure of one result, with its unit and digits."""
    name = key.removesuffix("_db").replace("_", " ")
    last = name.removeprefix("refit ")
    words = f"refit: {_WORDS.get(last, last)}" if last != name else _WORDS.get(name, name)
    if key.endswith("_db"):
        return f"{words} (dB)", f"{value:.2f}"
    digits = 0 if words.startswith("trials") else 2
    return words, f"{value:.{digits}f}" if isinstance(value, float) else str(value)


def simulate(
    procedure: Annotated[str, Option("imece2004, up-down, quest-plus, curve, or another package's.")] = "imece2004",
    runs: Annotated[int, Option("Simulated runs.")] = 1000,
    slope: Annotated[str, Option("Weibull slope, or LOW:HIGH to draw each run's from.")] = "2.5",
    lapse: Annotated[float, Option("Lapse rate.")] = _SETTING.default("lapse"),
    start_db: Annotated[float, Option("Start, dB above the true threshold.")] = _SETTING.default("start_db"),
    trials: Annotated[int | None, Option("Trials of a run, where the procedure has a number of them.")] = None,
    truth: Annotated[
        Place | None,
        Option("curve: everybody's threshold, a CSV with frequency_hz,level_db_sl (default: drawn).", file=True),
    ] = None,
    guess: Annotated[float, Option("Share of trials that are guessed outright; 1: all.")] = _SETTING.default("guessed"),
    drift_db: Annotated[float, Option("Rise of thresholds over the run, dB.")] = _SETTING.default("drift_db"),
    loud_share: Annotated[float, Option("Share of loud catch trials, as in [catch].")] = _SETTING.default("loud_share"),
    seed: Seed = 0,
) -> QualityResult:
    """Say how good a procedure's estimates are. It is run many times against a Weibull observer."""
    from tactuator.experiment.simulated.quality import Setting, simulate_kind
    from tactuator.io.csv_tables import read_relative_curve

    setting = Setting(runs, _slope_range(slope), lapse, start_db, seed, guess, drift_db, loud_share)
    people = None if truth is None else read_relative_curve(Path(truth))
    with working(f"{runs} runs", 1.0) as step:
        quality = simulate_kind(procedure, setting, trials, people, step)
    figures = plain(quality)
    assert isinstance(figures, dict)
    return QualityResult(procedure, runs, figures)


def _slope_range(text: str) -> tuple[float, float]:
    low, _, high = text.partition(":")
    try:
        return float(low), float(high or low)
    except ValueError:
        raise BadInput(f"slope {text!r}", "a number, or LOW:HIGH") from None

"""The part `sheet` of the verb `experiment`: a visit on one page, for a clinician to sign."""

import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tactuator.errors import BadInput
from tactuator.verbs.experiment import Code, StoreFile, StudyName
from tactuator.verbs.parameters import Option, Place
from tactuator.verbs.result import Result

if TYPE_CHECKING:
    from tactuator.experiment.protocol.study import StudyProtocol
    from tactuator.experiment.result.norms import Norm
    from tactuator.experiment.result.thresholds import MeasuredThreshold
    from tactuator.experiment.store.records import Found
    from tactuator.report.sheet import SheetRow


@dataclass(frozen=True, eq=False, repr=False)
class SheetResult(Result):
    """The page of a visit: where it is, and how many thresholds and unmet conditions are on it.

    z: of each threshold, None where the norm has none.
    """

    out: Path
    subject: str
    visit: int
    thresholds: int
    z: tuple[float | None, ...]
    unmet: tuple[str, ...]

    def tables(self) -> Sequence[str]:
        return [*self.unmet, f"written: {self.out}"]


def sheet(
    code: Code,
    store: StoreFile,
    out: Annotated[Place, Option("Page to write (HTML).", writes=True, type=Path)],
    norm: Annotated[
        Place | None, Option("Norm by age, with its source (CSV); none is shipped.", file=True, type=Path | None)
    ] = None,
    age: Annotated[float | None, Option("Age, years; default: the item `age` of the subject.", ge=0.0)] = None,
    study: StudyName = None,
    visit: Annotated[int, Option("Visit of the subject.", ge=1)] = 1,
) -> SheetResult:
    """Write the sheet of a visit, for a clinician to sign. It has who, when, conditions, thresholds with intervals,
    open to the side that was not reached, and z-scores against a norm of the clinic's.
    """
    from tactuator.experiment.language.words import shipped_words
    from tactuator.experiment.protocol.detection import Protocol
    from tactuator.experiment.result.norms import read_norm
    from tactuator.experiment.result.thresholds import thresholds
    from tactuator.experiment.session.studies import books_of, fresh_token
    from tactuator.experiment.session.task import SystemClock
    from tactuator.experiment.store import records
    from tactuator.experiment.store.store import Store
    from tactuator.experiment.store.stored_runs import detection_runs
    from tactuator.io.atomic import write_text
    from tactuator.report.sheet import sheet_html

    given = None if norm is None else read_norm(Path(norm))
    with closing(Store(Path(store), must_exist=True)) as database:
        with database.read() as connection:
            books = books_of(connection, study, fresh_token, SystemClock().utc(), records.PROGRAM)
            visits = [row for row in records.sessions(connection, books.study) if row.subject_code == code]
            row = next((row for row in visits if row.visit == visit), None)
            if row is None:
                raise BadInput(f"visit {visit} of subject {code!r}", f"one of {len(visits)} that are enrolled")
            facts = records.facts(connection, books.study).get(row.subject_id, {})
            noted = [each for kind in ("gate", "standard") for each in records.details(connection, row.id, kind)]
            gated = [] if row.protocol_version_id is None else noted
            posture = records.latest(connection, row.id, "posture")
        measured = thresholds(detection_runs(database, session=row.id))
    years = float(facts["age"]) if age is None and "age" in facts else age
    protocol, language = books.protocol, books.protocol.study.language
    words = shipped_words(language if protocol.study.language_file is None else "en")
    unmet = [*gated, *(map(str, protocol.unmet()) if isinstance(protocol, Protocol) else ())]
    scored = [_scored(threshold, given, years) for threshold in measured]
    about = _about(protocol, row, years, posture, measured)
    simulated = any(threshold.simulated for threshold in measured)
    page = sheet_html(words, about, [cells for cells, _ in scored], unmet, given.source if given else "", simulated)
    write_text(Path(out), page)
    return SheetResult(Path(out), code, visit, len(measured), tuple(z for _, z in scored), tuple(unmet))


def _scored(threshold: "MeasuredThreshold", norm: "Norm | None", age: float | None) -> "tuple[SheetRow, float | None]":
    """Return the row of a threshold, and its z; a threshold that lies beyond what was played has a bound for both."""
    from tactuator.report.sheet import SheetRow

    normal = None if norm is None else norm.row(threshold.finger, age, threshold.frequency_hz)
    z = None if normal is None else normal.z(threshold.level_db_re_1um)
    bound = {">=": "≥ ", "<=": "≤ "}.get(threshold.bound, "")
    low, high = (
        f"{level:.1f}" if math.isfinite(level) else endless
        for level, endless in ((threshold.level_low_db_re_1um, "−∞"), (threshold.level_high_db_re_1um, "∞"))
    )
    mean = "" if normal is None else f"{normal.mean_db_re_1um:.1f} ± {normal.sd_db:.1f}"
    cells = (
        threshold.finger,
        f"{threshold.frequency_hz:g}",
        f"{bound}{threshold.level_db_re_1um:.1f}",
        f"{low} … {high}",
    )
    return SheetRow(*cells, "" if z is None else f"{bound}{z:+.1f}", mean, ", ".join(threshold.flags)), z


def _about(
    protocol: "StudyProtocol", row: "Found", age: float | None, posture: str, measured: "Sequence[MeasuredThreshold]"
) -> list[tuple[str, str]]:
    """Return what the sheet says of person, day and display."""
    area = protocol.circumstances.contact_area_mm2
    return [
        ("study", protocol.study.name),
        ("subject", f"{row.subject_code} ({row.subject_group})"),
        ("age", _with_unit(age, "")),
        ("visit", f"{row.visit}: {(row.consented_utc or '')[:16].replace('T', ' ')}"),
        ("experimenter", protocol.study.experimenter),
        ("procedure", ", ".join(sorted({threshold.procedure for threshold in measured}))),
        ("site", protocol.circumstances.site),
        ("contact", "; ".join(part for part in (_with_unit(area, "mm²"), protocol.circumstances.surround) if part)),
        ("force", _with_unit(row.preload_n, "N")),
        ("temperature", _with_unit(row.skin_temperature_c, "°C")),
        ("posture", posture),
    ]


def _with_unit(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:g} {unit}".rstrip()

"""The parts of the verb `experiment` on a store as a whole: backup; and the sheet of a visit."""

import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tactuator.errors import BadInput
from tactuator.verbs.experiment import Code, StoreFile, StudyName
from tactuator.verbs.parameters import Argument, Option, Place
from tactuator.verbs.result import Result

if TYPE_CHECKING:
    from tactuator.experiment.protocol.study import StudyProtocol
    from tactuator.experiment.result.group_level import Norm
    from tactuator.experiment.result.thresholds import MeasuredThreshold
    from tactuator.experiment.store.records import Found
    from tactuator.experiment.store.stored_runs import StoredRun
    from tactuator.experiment.words import Words


StoreArgument = Annotated[
    Place, Argument("Store of the experiment: a file, or postgresql+pg8000://...", metavar="STORE", type=str)
]


@dataclass(frozen=True, eq=False, repr=False)
class BackupResult(Result):
    """A whole copy of a store; answers: their number in it."""

    out: Path
    answers: int

    def tables(self) -> Sequence[str]:
        return [f"{self.answers} answers"]


def backup(
    store: StoreArgument, out: Annotated[Place, Argument("File to write.", metavar="OUT", writes=True)]
) -> BackupResult:
    """Copy a store whole, also while it is served. Raises BadInput where the place cannot be written."""
    from sqlalchemy import func, select

    from tactuator.experiment.store import schema
    from tactuator.experiment.store.store import Store

    with closing(Store(store, must_exist=True, whole=False)) as database:
        database.backup(Path(out))
    with closing(Store(Path(out), must_exist=True)) as copy, copy.read() as connection:
        answers = connection.execute(select(func.count()).select_from(schema.response)).scalar_one()
    return BackupResult(Path(out), answers)


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
        return self.unmet


def sheet(
    code: Code,
    store: StoreFile,
    out: Annotated[Place, Option("Page to write (HTML).", writes=True, type=Path)],
    norm: Annotated[
        Place | None, Option("Norm by age, with its source (CSV); none is shipped.", file=True, type=Path | None)
    ] = None,
    age: Annotated[float | None, Option("Age, years; default: the item `age` of the subject.")] = None,
    study: StudyName = None,
    visit: Annotated[int, Option("Visit of the subject.", ge=1)] = 1,
) -> SheetResult:
    """Write the sheet of a visit, for a clinician to sign. It has who, when, conditions, thresholds with intervals,
    open to the side that was not reached, and z-scores against a norm of the clinic's.
    """
    from tactuator.experiment.protocol.detection import Protocol
    from tactuator.experiment.result.group_level import read_norm
    from tactuator.experiment.result.thresholds import thresholds
    from tactuator.experiment.session.studies import books_of, fresh_token
    from tactuator.experiment.session.task import SystemClock
    from tactuator.experiment.store import records
    from tactuator.experiment.store.store import Store
    from tactuator.experiment.store.stored_runs import detection_runs
    from tactuator.experiment.words import shipped_words
    from tactuator.io.atomic import write_text

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
        runs = detection_runs(database, session=row.id)
    measured = sorted(thresholds(runs), key=lambda each: (each.finger, each.frequency_hz))
    years = float(facts["age"]) if age is None and "age" in facts else age
    if years is not None and not 0.0 <= years <= _OLDEST:
        raise BadInput(f"age of {years:g} years", f"0 to {_OLDEST:g}")
    protocol, language = books.protocol, books.protocol.study.language
    words = shipped_words(language if protocol.study.language_file is None else "en")
    unmet = [*gated, *(map(str, protocol.unmet()) if isinstance(protocol, Protocol) else ())]
    scored = [_scored(threshold, given, years) for threshold in measured]
    about = _about(protocol, row, years, posture, runs)
    simulated = any(threshold.simulated for threshold in measured)
    page = _page(words, about, [cells for cells, _ in scored], unmet, given.source if given else "", simulated)
    write_text(Path(out), page)
    return SheetResult(Path(out), code, visit, len(measured), tuple(z for _, z in scored), tuple(unmet))


_OLDEST = 130.0
_HEADS = ("finger", "frequency", "threshold", "interval", "z", "norm", "flags")


def _scored(
    threshold: "MeasuredThreshold", norm: "Norm | None", age: float | None
) -> tuple[tuple[str, ...], float | None]:
    """Return the row of a threshold, and its z; a threshold that lies beyond what was played has a bound for both."""
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
    return (*cells, "" if z is None else f"{bound}{z:+.1f}", mean, ", ".join(threshold.flags)), z


def _about(
    protocol: "StudyProtocol", row: "Found", age: float | None, posture: str, runs: "Sequence[StoredRun]"
) -> list[tuple[str, str]]:
    area, began_utc = protocol.circumstances.contact_area_mm2, min(each.run.started_utc for each in runs)
    return [
        ("study", protocol.study.name),
        ("subject", f"{row.subject_code} ({row.subject_group})"),
        ("age", _with_unit(age, "")),
        ("visit", f"{row.visit}: {began_utc[:16].replace('T', ' ')}"),
        ("experimenter", protocol.study.experimenter),
        ("procedure", ", ".join(sorted({each.run.procedure for each in runs}))),
        ("site", protocol.circumstances.site),
        ("contact", "; ".join(part for part in (_with_unit(area, "mm²"), protocol.circumstances.surround) if part)),
        ("force", _with_unit(row.preload_n, "N")),
        ("temperature", _with_unit(row.skin_temperature_c, "°C")),
        ("posture", posture),
    ]


def _with_unit(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:g} {unit}".rstrip()


_STYLE = """@page { size: A4; margin: 16mm }
body { font: 15px/1.4 system-ui, sans-serif; color: #1b1f24; background: #fff; max-width: 46em; margin: 1.5em auto;
  padding: 0 1em; overflow-wrap: anywhere }
h1 { font-size: 1.4em } h2 { font-size: 1.1em; margin: 1.2em 0 .3em }
dl { display: grid; grid-template-columns: minmax(8em, max-content) 1fr; gap: .1em 1em; margin: 0 }
dt { color: #565f6b }
dd { margin: 0 } .wide { overflow-x: auto } table { border-collapse: collapse; width: 100%; overflow-wrap: normal }
th, td { border-bottom: 1px solid #c9d0d8; padding: .25em .5em; text-align: right; vertical-align: top }
th:first-child, td:first-child, td:last-child { text-align: left }
.note { border: 2px solid #b03a00; padding: .4em .8em }
.sign { display: flex; flex-wrap: wrap; gap: 2em; margin-top: 3em }
.sign div { flex: 1 1 12em; border-top: 1px solid #1b1f24; padding-top: .2em }"""


def _page(
    words: "Words",
    about: Sequence[tuple[str, str]],
    rows: Sequence[Sequence[str]],
    unmet: Sequence[str],
    source: str,
    simulated: bool,
) -> str:
    """Return the page. about: key of the table [sheet] of the language file, and what stands there. rows: thresholds by
    the cells of `_HEADS`. unmet: conditions. source: of the norm, "" without one. simulated: nobody felt the stimuli.
    """
    from html import escape

    def say(key: str) -> str:
        return escape(words(f"sheet.{key}"))

    listed = "".join(f"<dt>{say(key)}</dt><dd>{escape(value) or '–'}</dd>" for key, value in about)
    head = "".join(f'<th scope="col">{say(name)}</th>' for name in _HEADS)
    cells = ["".join(f"<td>{escape(cell) or '–'}</td>" for cell in row) for row in rows]
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    conditions = "".join(f"<li>{escape(condition)}</li>" for condition in unmet)
    norm = f"{say('norm_source')}: {escape(source)}" if source else say("no_norm")
    signed = "".join(f"<div>{say(key)}</div>" for key in ("place_date", "name", "signature"))
    return f"""<!doctype html>
<html lang="{escape(words.language)}"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{say("title")}</title><style>{_STYLE}</style></head>
<body><main><h1>{say("title")}</h1>
{f'<p class="note" role="note">{say("simulated")}</p>' if simulated else ""}
<dl>{listed}</dl>
<h2>{say("thresholds")}</h2>
<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>
<p>{say("explained")}</p><p>{norm}</p>
<h2>{say("unmet")}</h2>
{f"<ul>{conditions}</ul>" if conditions else f"<p>{say('none')}</p>"}
<div class="sign">{signed}</div></main></body></html>
"""

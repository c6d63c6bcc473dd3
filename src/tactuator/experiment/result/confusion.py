"""Confusion matrices and information transfer of a store's recognition blocks, and results as tables of text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, select

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.experiment.result.information import Information, information
from tactuator.experiment.result.played import was_simulated
from tactuator.experiment.result.thresholds import MeasuredThreshold
from tactuator.experiment.store import records, schema
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import TRIALS, selected
from tactuator.experiment.words import Words
from tactuator.result import ResultTable

_BOUNDS = {"": "", ">=": "≥ ", "<=": "≤ "}
_POWER_MIN, _SESSION_DRAWS = 0.5, 300


def threshold_table(thresholds: Sequence[MeasuredThreshold], words: Words) -> ResultTable:
    """Return a table with a row for each threshold."""
    columns = ["subject", "finger", "hertz", "trials", "procedure", "refit", "interval", "level", "flags"]
    heads = tuple(words(f"results.{name}", **({"percent": 95} if name == "interval" else {})) for name in columns)
    rows = tuple(
        (
            threshold.subject,
            threshold.finger,
            f"{threshold.frequency_hz:.4g}",
            str(threshold.trials),
            "–" if threshold.own_db_sl is None else f"{threshold.own_db_sl:.1f}",
            f"{_BOUNDS[threshold.bound]}{threshold.refit_db_sl:.1f}",
            _interval(threshold, words),
            f"{_BOUNDS[threshold.bound]}{threshold.level_db_re_1um:.1f}",
            ", ".join(words(f"results.flag_{name.replace('-', '_')}") for name in threshold.flags),
        )
        for threshold in thresholds
    )
    points = ", ".join(sorted({f"{100.0 * threshold.point:.1f}" for threshold in thresholds}))
    notes = [words("results.point", percent=points)]
    notes += _nobody(words, any(threshold.simulated for threshold in thresholds))
    for name, powers in (
        ("results.lapses_unjudged", [threshold.lapse_power for threshold in thresholds]),
        ("results.drift_unjudged", [threshold.drift_power for threshold in thresholds]),
    ):
        weak = sum(power is not None and power < _POWER_MIN for power in powers)
        if weak:
            notes.append(words(name, count=weak, all=len(thresholds)))
    notes += _notches(thresholds, words)
    return ResultTable(words("results.thresholds"), heads, rows, tuple(notes))


def _notches(thresholds: Sequence[MeasuredThreshold], words: Words) -> list[str]:
    runs: dict[int, list[str]] = {}
    for each in thresholds:
        if each.notch_trials:
            place = words("results.notch_place", hertz=f"{each.frequency_hz:.4g}", count=each.notch_trials)
            runs.setdefault(each.run, [each.subject]).append(place)
    return [f"{who}: {words('results.notch_open', places=', '.join(places))}" for who, *places in runs.values()]


def _interval(threshold: MeasuredThreshold, words: Words) -> str:
    """Return the 95 % interval; of one that is open to a side, the end that is known."""
    low, high = (f"{end:.1f}" for end in (threshold.refit_low_db_sl, threshold.refit_high_db_sl))
    if math.isinf(threshold.refit_high_db_sl):
        return "–" if math.isinf(threshold.refit_low_db_sl) else f"{_BOUNDS['>=']}{low}"
    if math.isinf(threshold.refit_low_db_sl):
        return f"{_BOUNDS['<=']}{high}"
    return words("results.range", low=low, high=high)


def information_table(title: str, information: Information, words: Words, simulated: bool = False) -> ResultTable:
    """Return a table with a row for each estimator; simulated: nobody felt the items, as it then says."""
    rates = information.bits_per_second or {}
    rows = tuple(
        (
            words(f"results.estimator_{name}"),
            _number(estimate.bits, 2),
            "–" if estimate.low_bits is None else f"{estimate.low_bits:.2f} – {estimate.high_bits:.2f}",
            _number(estimate.categories, 1),
            _number(rates.get(name, math.nan), 2),
        )
        for name, estimate in information.estimates.items()
    )
    correct = _number(100.0 * information.share_correct, 1)
    answered = words("results.answered", trials=information.trials, stimuli=information.stimuli, percent=correct)
    warnings = [words("results.warning", text=reason.told(words)) for reason in information.reasons]
    heads = (
        words("results.estimator"),
        words("results.bits"),
        words("results.interval", percent=f"{100.0 * information.confidence:g}"),
        words("results.categories"),
        words("results.rate"),
    )
    return ResultTable(title, heads, rows, (*_nobody(words, simulated), answered, *warnings))


def _nobody(words: Words, simulated: bool) -> tuple[str, ...]:
    return (words("results.simulated"),) if simulated else ()


def _number(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def matrix_table(result: SubjectResult, words: Words) -> ResultTable:
    """Return the confusion matrix as a table."""
    rows = tuple(
        (label, *map(str, counts)) for label, counts in zip(result.labels, result.counts.tolist(), strict=True)
    )
    return ResultTable(words("results.matrix"), ("", *result.labels), rows, _nobody(words, result.simulated))


def abx_table(result: AbxResult, words: Words) -> ResultTable:
    """Return the share of right answers as a table."""
    row = (str(result.trials), f"{100.0 * result.share_correct:.1f}")
    heads = (words("results.trials"), words("results.correct"))
    return ResultTable(words("results.abx"), heads, (row,), _nobody(words, result.simulated))


@dataclass(frozen=True, eq=False)
class SubjectResult:
    """Confusion matrix of a subject with its information transfer.

    subject: a code, or None for all of a study together. counts: (stimuli, responses) in the order of `labels`.
    seconds_per_stimulus: mean duration of the items asked for; in the middle of three, from one onset to the next.
    simulated: True where nobody felt some of them.
    """

    study: str
    paradigm: str
    subject: str | None
    labels: tuple[str, ...]
    counts: NDArray[np.int64]
    seconds_per_stimulus: float
    information: Information
    simulated: bool = False


@dataclass(frozen=True)
class AbxResult:
    """Share of right answers of a subject in ABX trials. simulated: True where nobody felt some of them."""

    study: str
    subject: str
    trials: int
    share_correct: float
    simulated: bool = False


def recognition_results(
    store: Store, rng: np.random.Generator, study: str | None = None, draws: int = 1000
) -> tuple[list[SubjectResult], list[AbxResult]]:
    """Return the results of every recognition study in the store (or the one of that name), test blocks only.

    Raises BadInput without answers.
    """
    results, abx = list[SubjectResult](), list[AbxResult]()
    with store.read() as connection:
        for row in connection.execute(select(schema.study).order_by(schema.study.c.id)):
            if study is not None and row.name != study:
                continue
            if connection.execute(select(schema.stimulus.c.id).where(schema.stimulus.c.study_id == row.id)).first():
                protocol = parse_protocol(records.versions(connection, row.id)[-1].toml, RecognitionProtocol)
                matrices, shares = _results(connection, row.id, protocol, rng, draws, store.usable)
                results, abx = results + matrices, abx + shares
    if not results and not abx:
        wanted = "recognition study" if study is None else f"recognition study {study!r}"
        raise BadInput(f"store {store.name}: no answers of any {wanted}", "a store with test blocks answered")
    return results, abx


def session_results(
    store: Store, protocol: RecognitionProtocol, session: int, rng: np.random.Generator
) -> tuple[list[SubjectResult], list[AbxResult]]:
    """Return the results of one session, test blocks only.

    Both lists are empty while fewer than two items were answered there.
    """
    with store.read() as connection:
        row = records.session(connection, session)
        return _results(connection, row.study_id, protocol, rng, _SESSION_DRAWS, store.usable, row.subject_code)


def _trials(connection: Connection, study: int, usable: schema.Usable) -> list[tuple[str, str, str, bool]]:
    """Return (subject, correct, response, nobody felt it) of each trial of test blocks that were not given up."""
    felt = ("subject_group", "respondent", "rig_simulated")
    query = (
        select(*selected("trials", "subject", "correct_response", "response", *felt))
        .select_from(TRIALS)
        .where(
            schema.session.c.study_id == study,
            *usable,
            schema.run.c.practice.is_(False),
            schema.run.c.state.in_(("running", "done")),
        )
        .order_by(schema.subject.c.number, schema.session.c.visit, schema.run.c.position, schema.trial.c.number)
    )
    return [(*row[:3], was_simulated(row.subject_group, row)) for row in connection.execute(query)]


def _results(
    connection: Connection,
    study: int,
    protocol: RecognitionProtocol,
    rng: np.random.Generator,
    draws: int,
    usable: schema.Usable,
    only: str | None = None,
) -> tuple[list[SubjectResult], list[AbxResult]]:
    trials, asking, name = _trials(connection, study, usable), protocol.recognition, protocol.study.name
    query = select(schema.stimulus.c.label, schema.stimulus.c.duration_s).where(schema.stimulus.c.study_id == study)
    durations = {row.label: row.duration_s for row in connection.execute(query)}
    labels = (*protocol.labels, *(label for label in durations if label not in protocol.labels))
    gap_s = asking.gap_s if asking.paradigm == "middle-of-three" else 0.0
    people = [who for who in dict.fromkeys(who for who, *_ in trials) if only in (None, who)]
    results, abx = list[SubjectResult](), list[AbxResult]()
    for subject in (*people, *([None] if len(people) > 1 and asking.paradigm != "abx" else [])):
        mine = [about for who, *about in trials if subject in (None, who)]
        nobody_felt = any(nobody for *_, nobody in mine)
        if asking.paradigm == "abx":
            share = float(np.mean([correct == response for correct, response, _ in mine]))
            abx.append(AbxResult(name, str(subject), len(mine), share, nobody_felt))
            continue
        counts = np.zeros((len(labels), len(labels)), dtype=np.int64)
        for correct, response, _ in mine:
            counts[labels.index(correct), labels.index(response)] += 1
        if np.count_nonzero(counts.sum(axis=1)) >= 2:
            seconds = float(np.mean([durations[correct] for correct, *_ in mine])) + gap_s
            transfer = information(counts, rng, seconds_per_stimulus=seconds, draws=draws)
            results.append(
                SubjectResult(name, asking.paradigm, subject, labels, counts, seconds, transfer, nobody_felt)
            )
    return results, abx

"""Results of a store's recognition blocks: confusion matrices and information transfer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, select

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_recognition
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.experiment.result.information import Information, information
from tactuator.experiment.store import schema, study_records
from tactuator.experiment.store.store import Store


@dataclass(frozen=True, eq=False)
class SubjectResult:
    """Confusion matrix of a subject with its information transfer.

    subject: a code, or None for all of a study together. counts: (stimuli, responses) in the order of `labels`.
    seconds_per_stimulus: mean duration of the items asked for; in the middle of three, from one onset to the next.
    """

    study: str
    paradigm: str
    subject: str | None
    labels: tuple[str, ...]
    counts: NDArray[np.int64]
    seconds_per_stimulus: float
    information: Information


@dataclass(frozen=True)
class AbxResult:
    """Share of right answers of a subject in ABX trials."""

    study: str
    subject: str
    trials: int
    share_correct: float


def recognition_results(
    store: Store, rng: np.random.Generator, study: str | None = None, draws: int = 1000
) -> tuple[list[SubjectResult], list[AbxResult]]:
    """Return the results of every recognition study in the store (or the one of that name), test blocks only.

    Raises BadInput where there is none with answers.
    """
    results: list[SubjectResult] = []
    abx: list[AbxResult] = []
    with store.read() as connection:
        for row in connection.execute(select(schema.study).order_by(schema.study.c.id)):
            if study is not None and row.name != study:
                continue
            if connection.execute(select(schema.stimulus.c.id).where(schema.stimulus.c.study_id == row.id)).first():
                protocol = parse_recognition(study_records.versions(connection, row.id)[-1].toml)
                if protocol.recognition.paradigm == "abx":
                    abx += _abx_results(connection, row.id, row.name)
                else:
                    results += _matrix_results(connection, row.id, protocol, rng, draws)
    if not results and not abx:
        wanted = "recognition study" if study is None else f"recognition study {study!r}"
        raise BadInput(f"store {store.path}: no answers of any {wanted}", "a store with test blocks answered")
    return results, abx


def session_results(
    store: Store, protocol: RecognitionProtocol, session: int, rng: np.random.Generator, draws: int = 300
) -> tuple[list[SubjectResult], list[AbxResult]]:
    """Return the results of one session, test blocks only.

    Both lists are empty while fewer than two items were answered there.
    """
    with store.read() as connection:
        row = study_records.session(connection, session)
        if protocol.recognition.paradigm == "abx":
            every = _abx_results(connection, row.study_id, protocol.study.name)
            return [], [one for one in every if one.subject == row.subject_code]
        return _matrix_results(connection, row.study_id, protocol, rng, draws, only=row.subject_code), []


def _trials(connection: Connection, study: int) -> list[tuple[str, str, str]]:
    """Return (subject, correct response, response) of every answered trial of test blocks that were not given up."""
    query = (
        select(schema.subject.c.code, schema.trial.c.correct_response, schema.response.c.response)
        .join(schema.session, schema.session.c.subject_id == schema.subject.c.id)
        .join(schema.run, schema.run.c.session_id == schema.session.c.id)
        .join(schema.trial, schema.trial.c.run_id == schema.run.c.id)
        .join(schema.response, schema.response.c.trial_id == schema.trial.c.id)
        .where(
            schema.session.c.study_id == study,
            schema.session.c.ended.is_distinct_from("withdrawn-discard"),
            schema.run.c.practice.is_(False),
            schema.run.c.state.in_(("running", "done")),
        )
        .order_by(schema.subject.c.number, schema.session.c.visit, schema.run.c.position, schema.trial.c.number)
    )
    return [tuple(row) for row in connection.execute(query)]


def _matrix_results(
    connection: Connection,
    study: int,
    protocol: RecognitionProtocol,
    rng: np.random.Generator,
    draws: int,
    only: str | None = None,
) -> list[SubjectResult]:
    trials = _trials(connection, study)
    query = select(schema.stimulus.c.label, schema.stimulus.c.duration_s).where(schema.stimulus.c.study_id == study)
    durations = {row.label: row.duration_s for row in connection.execute(query)}
    labels = (*protocol.labels, *(label for label in durations if label not in protocol.labels))
    asking = protocol.recognition
    gap_s = asking.gap_s if asking.paradigm == "middle-of-three" else 0.0
    subjects: list[str | None] = list(dict.fromkeys(subject for subject, *_ in trials))
    if only is not None:
        subjects = [subject for subject in subjects if subject == only]
    elif len(subjects) > 1:
        subjects.append(None)
    results = []
    for subject in subjects:
        mine = [(correct, response) for who, correct, response in trials if subject in (None, who)]
        counts = np.zeros((len(labels), len(labels)), dtype=np.int64)
        for correct, response in mine:
            counts[labels.index(correct), labels.index(response)] += 1
        if np.count_nonzero(counts.sum(axis=1)) < 2:
            continue
        seconds = float(np.mean([durations[correct] for correct, _ in mine])) + gap_s
        found = information(counts, rng, seconds_per_stimulus=seconds, draws=draws)
        results.append(SubjectResult(protocol.study.name, asking.paradigm, subject, labels, counts, seconds, found))
    return results


def _abx_results(connection: Connection, study: int, name: str) -> list[AbxResult]:
    trials = _trials(connection, study)
    results = []
    for subject in dict.fromkeys(who for who, *_ in trials):
        right = [correct == response for who, correct, response in trials if who == subject]
        results.append(AbxResult(name, subject, len(right), float(np.mean(right))))
    return results

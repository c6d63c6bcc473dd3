"""The verbs `experiment recognise` and `experiment information`: closed-set recognition, from items to bits."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, progress, shown
from tactuator.cli.experiment.apparatus import opened_apparatus
from tactuator.cli.experiment.terminal import Terminal
from tactuator.errors import BadInput
from tactuator.experiment.language.words import shipped_words
from tactuator.experiment.protocol.file import read_recognition
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.experiment.result.confusion import AbxResult, SubjectResult, information_table, recognition_results
from tactuator.experiment.result.information import Information, information
from tactuator.experiment.session.presented_session import PresentedSession, run_session
from tactuator.experiment.session.studies import fresh_token, open_session, open_study, task_of
from tactuator.experiment.session.task import SystemClock
from tactuator.experiment.simulated.respondents import ErringRespondent
from tactuator.experiment.store.records import Sitting
from tactuator.experiment.store.store import Store, opened_store, sessions_of
from tactuator.io.matrix import read_matrix


def recognise_items(
    protocol: Path,
    store: Path,
    subject: str | None,
    display: Path | None,
    controller: Path | None,
    rig: str,
    scripted_error: float | None,
    seed: int,
    as_json: bool,
) -> None:
    """Take a subject through a recognition experiment at the terminal; it goes on where it stopped."""
    read, text = read_recognition(protocol)
    code = _subject(read, subject)
    scripted = None if scripted_error is None else ErringRespondent(scripted_error, np.random.default_rng([seed, 7]))
    speed = 1.0 if scripted_error is None else None
    with sessions_of(store), opened_apparatus(rig, display, controller, seed, speed) as place:
        task, clock = task_of(read, protocol.parent, place), SystemClock()
        with opened_store(store) as database:
            study = open_study(database, task, text, clock, fresh_token, beside=protocol.parent)
            presented = PresentedSession(
                open_session(study, code, sitting=Sitting("person" if scripted is None else "script"))
            )
            with progress() as bars:
                bar = bars.add_task(code, total=sum(run.trials or 0 for run in presented.session.runs))
                respondent = scripted or Terminal(task.question, task.words)
                trials = run_session(presented, respondent, lambda session: bars.update(bar, completed=session.trials))
    table = Table("subject", "trials answered now")
    table.add_row(code, str(trials))
    answer({"subject": code, "trials": trials, "store": str(store)}, as_json, table)


def _subject(protocol: RecognitionProtocol, subject: str | None) -> str:
    codes = [one.code for one in protocol.subject]
    if subject is None and len(codes) > 1:
        raise BadInput(f"{len(codes)} subjects are in the protocol", f"--subject with one of {', '.join(codes)}")
    return codes[0] if subject is None else subject


def transfer(
    store: Path | None,
    matrix: Path | None,
    study: str | None,
    seconds: float | None,
    draws: int,
    seed: int,
    as_json: bool,
) -> None:
    """Estimate information transfer in five ways, one with an interval, from a store's studies or any matrix."""
    if (store is None) == (matrix is None):
        raise BadInput("--store and --matrix", "one of the two")
    rng = np.random.default_rng(seed)
    if matrix is not None:
        named = read_matrix(matrix)
        found = information(named.counts, rng, seconds_per_stimulus=seconds, draws=draws)
        answer(
            {"matrix": str(matrix), **_plain(found)},
            as_json,
            shown(information_table(str(matrix), found, shipped_words("en"))),
        )
        return
    if seconds is not None:
        raise BadInput("--seconds with --store", "with --matrix, since a store knows its stimuli's durations")
    assert store is not None
    database = Store(store, must_exist=True)
    try:
        results, abx = recognition_results(database, rng, study, draws)
    finally:
        database.close()
    figures = {"results": [_result(one) for one in results], "abx": [asdict(one) for one in abx]}
    answer(
        figures,
        as_json,
        Group(
            *(shown(information_table(_title(one), one.information, shipped_words("en"))) for one in results),
            *map(_abx, abx),
        ),
    )


def _plain(found: Information) -> dict[str, Any]:
    figures = asdict(found)
    del figures["reasons"]  # they are in warning and no_interval, as one line each
    for name, estimate in found.estimates.items():
        figures["estimates"][name]["categories"] = estimate.categories
    return figures


def _result(one: SubjectResult) -> dict[str, Any]:
    return {
        "study": one.study,
        "paradigm": one.paradigm,
        "subject": one.subject,
        "labels": list(one.labels),
        "matrix": one.counts.tolist(),
        "seconds_per_stimulus": one.seconds_per_stimulus,
        **_plain(one.information),
    }


def _title(one: SubjectResult) -> str:
    return f"{one.study}, {'all subjects' if one.subject is None else one.subject} ({one.paradigm})"


def _abx(one: AbxResult) -> str:
    return f"{one.study}, {one.subject} (abx): {one.trials} trials, {100 * one.share_correct:.1f} % correct"

"""tactuator experiment identify and information: closed-set identification, from items to bits."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console, Group
from rich.table import Table

from tactuator.cli.answer import answer, progress
from tactuator.cli.experiment_station import station
from tactuator.cli.options import AsJson, Seed
from tactuator.errors import BadInput
from tactuator.experiment.clock import SystemClock
from tactuator.experiment.identification import Block
from tactuator.experiment.identification_protocol import IdentificationProtocol, read_identification
from tactuator.experiment.identification_respondents import ErringRespondent
from tactuator.experiment.identification_result import AbxResult, SubjectResult, identification_results
from tactuator.experiment.identification_session import IdentificationStudy, Respondent
from tactuator.experiment.information import Information, information
from tactuator.experiment.store import Store
from tactuator.experiment.trial import Trial
from tactuator.files.matrix import read_matrix


def register(experiment: typer.Typer) -> None:
    """Add the commands to `experiment`."""
    experiment.command("identify")(identify)
    experiment.command("information")(information_command)


def identify(
    protocol: Annotated[Path, typer.Argument(help="Identification protocol (TOML).", metavar="PROTOCOL")],
    store: Annotated[Path, typer.Option("--store", help="Database of the experiment (SQLite).")],
    subject: Annotated[
        str | None, typer.Option("--subject", help="Code of the subject; default: the only one.")
    ] = None,
    controller: Annotated[
        Path | None, typer.Option("--controller", help="controller.json; default: the paper's display and C.")
    ] = None,
    rig: Annotated[str, typer.Option("--rig", help="simulated.")] = "simulated",
    scripted_error: Annotated[
        float | None, typer.Option("--scripted-error", help="A script answers for the subject, wrong at this rate.")
    ] = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Take a subject through an identification experiment at the terminal; it goes on where it stopped."""
    read, text = read_identification(protocol)
    code = _subject(read, subject)
    place = station(rig, controller, seed, None if scripted_error is not None else 1.0)
    place.rig.load(place.controller)
    respondent: Respondent
    if scripted_error is None:
        respondent = _Terminal(read)
    else:
        respondent = ErringRespondent(scripted_error, np.random.default_rng([seed, 7]))
    database = Store(store)
    try:
        study = IdentificationStudy.open(read, text, protocol.parent, place, database, SystemClock())
        with progress() as bars:
            task = bars.add_task(code, total=None)
            trials = study.run(code, respondent, lambda done, total: bars.update(task, completed=done, total=total))
    finally:
        database.close()
    table = Table("subject", "trials answered now")
    table.add_row(code, str(trials))
    answer({"subject": code, "trials": trials, "store": str(store)}, as_json, table)


def _subject(protocol: IdentificationProtocol, subject: str | None) -> str:
    codes = [one.code for one in protocol.subject]
    if subject is None and len(codes) > 1:
        raise BadInput(f"{len(codes)} subjects are in the protocol; allowed: --subject with one of {', '.join(codes)}")
    return codes[0] if subject is None else subject


class _Terminal:
    """A person who types keys."""

    def __init__(self, protocol: IdentificationProtocol) -> None:
        self._keys = {item.key: item.label for item in protocol.item}
        self._console = Console(stderr=True)

    def begin(self, block: Block) -> None:
        kind = "training" if block.training else "test"
        self._console.print(f"Block {block.position + 1}, {kind}: {len(block.trials)} trials")

    def respond(self, trial: Trial) -> str:
        keys = {key: label for key, label in self._keys.items() if label in trial.responses}
        keys = keys or {response.lower(): response for response in trial.responses}
        offered = ", ".join(f"{key} = {label}" for key, label in keys.items())
        while True:
            typed = typer.prompt(offered, prompt_suffix=" > ", err=True)
            if typed.strip() in keys:
                return keys[typed.strip()]
            self._console.print(f"{typed!r} is no key of these")

    def learn(self, trial: Trial, correct: bool) -> None:
        self._console.print("right" if correct else f"it was {trial.correct}")


def information_command(
    store: Annotated[Path | None, typer.Option("--store", help="Database of identification experiments.")] = None,
    matrix: Annotated[
        Path | None, typer.Option("--matrix", help="A confusion matrix of your own (CSV): a row a stimulus.")
    ] = None,
    study: Annotated[str | None, typer.Option("--study", help="Only the study of this name.")] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", help="With --matrix: seconds a stimulus, for bits per second.")
    ] = None,
    resamples: Annotated[int, typer.Option("--resamples", min=1, help="Of the bootstrap.")] = 1000,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Information transfer by four estimators with bootstrap intervals, of a store's studies or of any matrix."""
    if (store is None) == (matrix is None):
        raise BadInput("--store and --matrix; allowed: one of the two")
    rng = np.random.default_rng(seed)
    if matrix is not None:
        named = read_matrix(matrix)
        found = information(named.counts, rng, seconds_per_stimulus=seconds, resamples=resamples)
        answer({"matrix": str(matrix), **_plain(found)}, as_json, _shown(str(matrix), found))
        return
    if seconds is not None:
        raise BadInput("--seconds with --store; allowed: with --matrix, since a store knows its stimuli's durations")
    assert store is not None
    database = Store(store, must_exist=True)
    try:
        results, abx = identification_results(database, rng, study, resamples)
    finally:
        database.close()
    figures = {"results": [_result(one) for one in results], "abx": [asdict(one) for one in abx]}
    answer(figures, as_json, Group(*(_shown(_title(one), one.information) for one in results), *map(_abx, abx)))


def _plain(found: Information) -> dict[str, Any]:
    figures = asdict(found)
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


def _shown(title: str, found: Information) -> Group:
    table = Table("estimator", "bits", f"{100 * found.confidence:g} %", "2^bits", "bits/s", title=title)
    for name, estimate in found.estimates.items():
        rate = "–" if found.bits_per_second is None else f"{found.bits_per_second[name]:.2f}"
        span = f"{estimate.low_bits:.2f} – {estimate.high_bits:.2f}"
        table.add_row(name.replace("_", " "), f"{estimate.bits:.2f}", span, f"{estimate.categories:.1f}", rate)
    lines = [f"{found.trials} trials, {found.stimuli} stimuli, {100 * found.share_correct:.1f} % correct"]
    return Group(table, *lines, *([] if found.warning is None else [f"warning: {found.warning}"]))


def _abx(one: AbxResult) -> str:
    return f"{one.study}, {one.subject} (abx): {one.trials} trials, {100 * one.share_correct:.1f} % correct"

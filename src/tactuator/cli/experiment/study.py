"""The verbs `experiment serve`, `observe`, `thresholds` and `export`: a study from protocol to tables."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, progress, working, written
from tactuator.cli.experiment.apparatus import opened_apparatus
from tactuator.cli.experiment.observers import lapses_of, truths_of
from tactuator.cli.experiment.results import results
from tactuator.cli.experiment.serve import serve
from tactuator.experiment.export.export import export
from tactuator.experiment.protocol.file import read_protocol
from tactuator.experiment.session.task import SystemClock
from tactuator.experiment.simulated.sitting import run_study, simulated_observers, with_truths
from tactuator.experiment.store.store import Store, opened_store, sessions_of
from tactuator.rig.finger import touchable, usual_load
from tactuator.web.address import Address


def serve_study(
    protocol: Path,
    store: Path,
    rig: str,
    display: Path | None,
    controller: Path | None,
    host: str,
    port: int,
    allowed_host: list[str] | None,
    tls_certificate: Path | None,
    tls_key: Path | None,
    operator_token_file: Path | None,
    speed: float,
    auto_start: bool,
    amend: str | None,
    show: bool,
    seed: int,
) -> None:
    """Serve the study to browsers: one page for every subject, one for the operator.

    Without a display or controller file: the paper's display and C. A study is known by its name; further subjects in
    its protocol are enrolled, anything else that changed takes --amend.
    """
    address = Address(host, port, tuple(allowed_host or ()), tls_certificate, tls_key)
    with opened_apparatus(rig, display, controller, seed, speed or None) as place:
        serve(protocol, store, place, address, operator_token_file, auto_start, amend, show)


def observe(
    protocol: Path,
    store: Path,
    rig: str,
    display: Path | None,
    controller: Path | None,
    load: str | None,
    truth: list[str] | None,
    lapse: list[str] | None,
    seed: int,
    as_json: bool,
) -> None:
    """Let simulated subjects go through the study at the simulated display; they feel what the loop makes of it."""
    read, text = read_protocol(protocol)
    truths, lapses = truths_of(truth or []), lapses_of(lapse or [])
    with sessions_of(store), opened_apparatus(rig, display, controller, seed, None) as place, progress() as bars:
        touchable(place.rig, place.name)
        curve = place.controller.display.channels[0].threshold.curve
        drawn = simulated_observers(curve, len(read.subject), seed, place.band_hz)
        observers = with_truths(drawn, [subject.code for subject in read.subject], curve, truths, lapses)
        task = bars.add_task("observers", total=1000 * len(observers))
        at = {one.name: index for index, one in enumerate(observers)}

        def show(name: str, share: float) -> None:
            bars.update(task, completed=round(1000 * (at[name] + share)))

        with opened_store(store) as database:
            touching = load or usual_load(place.controller.display.channels)
            named = None if touching == "none" else touching
            run_study(database, read, text, place, observers, SystemClock(), named, show)
    true = [
        {"subject": subject.code, "frequency_hz": hertz, "true_db_re_1um": float(one.curve.level_db_re_1um_at(hertz))}
        for subject, one in zip(read.subject, observers, strict=True)
        for hertz in read.conditions.frequencies_hz or np.geomspace(*place.band_hz, 12).round(3).tolist()
    ]
    table = Table("subject", "frequency (Hz)", "true threshold (dB re 1 µm)")
    for row in true:
        table.add_row(str(row["subject"]), f"{row['frequency_hz']:.4g}", f"{row['true_db_re_1um']:.1f}")
    answer({"store": str(store), "truth": true}, as_json, Group(table, *written(store)))


def show_thresholds(
    store: Path,
    group: str | None,
    reference: str | None,
    curve_out: Path | None,
    figures: Path | None,
    keep_flagged: bool,
    as_json: bool,
) -> None:
    """Refit thresholds of every finished run, with flags, and the curve across subjects."""
    found, table, refused = results(store, group, reference, curve_out, figures, keep_flagged)
    answer(found, as_json, table)
    if refused is not None:
        raise refused


def write_export(store: Path, out: Path, form: str, as_json: bool) -> None:
    """Write every answered trial in an open format, with its data dictionary."""
    with working("exporting"), closing(Store(store, must_exist=True)) as database:
        count = export(database, out, form)
    said = Group(f"{count} trials exported", *written(out))
    answer({"folder": str(out), "format": form, "trials": count}, as_json, said)

"""The verb `identify`: a model with its uncertainty from a record."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import typer
from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, progress, written
from tactuator.cli.model.identify_document import document, response_document
from tactuator.errors import BadInput
from tactuator.identification.asked import Asked
from tactuator.identification.by_response import ResponseFit, identify_response
from tactuator.identification.fixed.value import Fixed
from tactuator.identification.identify import identify
from tactuator.identification.result import Identification
from tactuator.identification.validation import validated
from tactuator.io.foreign_response import is_response, read_foreign_response
from tactuator.io.model import write_identified
from tactuator.io.record import read_record
from tactuator.report.tables import identification_rows, response_rows
from tactuator.signals.record import Record


def run(
    records: list[Path],
    input_name: str | None,
    output_name: str | None,
    reference_name: str | None,
    time_name: str | None,
    rate_hz: float | None,
    from_s: float | None,
    to_s: float | None,
    order: int | None,
    zeros: int | None,
    integrators: int,
    delay_s: float | None,
    fix: list[str] | None,
    hold: str,
    method: str,
    quantity: str,
    forgetting: float,
    friction: bool,
    validate: list[Path] | None,
    out: Path | None,
    figures: Path | None,
    as_json: bool,
) -> None:
    """Identify a continuous model of a recorded mechanism, with its confidence band."""
    fixed = tuple(Fixed.parse(one) for one in fix or [])
    asked = Asked(order, zeros, integrators, delay_s, hold, quantity, friction, fixed)
    if is_response(records[0]):
        if len(records) > 1 or validate:
            raise BadInput("a frequency response beside other files", "one response by itself")
        deliver_response(records[0], asked, out, as_json)
        return

    def read(path: Path) -> Record:
        return read_record(
            path,
            input_name=input_name,
            output_name=output_name,
            reference_name=reference_name,
            time_name=time_name,
            rate_hz=rate_hz,
        )

    parts = [part_of(read(path), from_s, to_s) for path in records]
    unseen = [(str(path), read(path)) for path in validate or []]
    with steps() as note:
        found = identify(parts, method=method, forgetting=forgetting, note=note, **vars(asked))
        note("validating")
        found = validated(found, unseen)
    deliver(found, parts[0], out, figures, as_json)


def _say_and_write(found: Identification | ResponseFit, out: Path | None) -> None:
    """Say what there is to remark and why not to trust the model, and write it where it is asked for."""
    for remark in found.remarks:
        sys.stderr.write(f"tactuator: note: {remark}\n")
    for reason in found.distrust:
        sys.stderr.write(f"tactuator: the model is not to be trusted: {reason}\n")
    if out is not None:
        write_identified(out, found.model)


def deliver_response(path: Path, asked: Asked, out: Path | None, as_json: bool) -> None:
    """Identify a frequency response; exit status 1 where the model is not to be trusted."""
    with steps() as note:
        found = identify_response(read_foreign_response(path), asked, note)
    _say_and_write(found, out)
    table = Table("what", "value", title=f"response: {found.order} poles, {found.model.num.size - 1} zeros")
    for row in response_rows(found):
        table.add_row(*row)
    answer(response_document(found) | {"out": out}, as_json, Group(table, *written(out)))
    if found.distrust:
        raise typer.Exit(1)


def deliver(found: Identification, read: Record, out: Path | None, figures: Path | None, as_json: bool) -> None:
    """Say, write and print what was found; exit status 1 where the model is not to be trusted."""
    _say_and_write(found, out)
    if figures is not None:
        from tactuator.report.device import save_identification  # matplotlib takes a second

        save_identification(found, figures)
    columns = {name: read.about.get(name) for name in ("input", "output")}
    answer(document(found) | {"columns": columns, "out": out}, as_json, _table(found, read.about, out))
    if found.distrust:
        raise typer.Exit(1)


def part_of(record: Record, from_s: float | None, to_s: float | None) -> Record:
    """Return the record between two times, seconds from its first sample; BadInput where that is nothing."""
    if from_s is None and to_s is None:
        return record
    first, last = from_s or 0.0, record.duration_s if to_s is None else to_s
    if not 0.0 <= first < last <= record.duration_s + 1.0 / record.rate_hz:
        raise BadInput(f"from {first:g} s to {last:g} s", f"ascending, within 0 .. {record.duration_s:g} s")
    piece = slice(round(first * record.rate_hz), round(last * record.rate_hz))
    about = record.about | {"from_s": f"{first:g}", "to_s": f"{last:g}"}
    return replace(record.part(piece), about=about)


@contextmanager
def steps() -> Iterator[Callable[[str], None]]:
    """Yield a function that shows on a terminal which step is under way."""
    with progress() as bars:
        task = bars.add_task("identifying", total=None)
        yield lambda text: bars.update(task, description=f"identifying: {text}")


def _table(found: Identification, about: dict[str, str], out: Path | None) -> Group:
    title = f"{found.model.method}: {found.order} poles, {found.model.num.size - 1} zeros"
    table = Table("what", "value", "±95 %", title=title)
    for row in identification_rows(found, about):
        table.add_row(*row)
    return Group(table, *written(out))

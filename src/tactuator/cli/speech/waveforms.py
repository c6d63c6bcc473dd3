"""The verb `waveforms`: a set of synthetic waveforms, and a recognition protocol that asks for them."""

from __future__ import annotations

import string
from dataclasses import replace
from pathlib import Path

from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, working, written
from tactuator.cli.chosen import chosen_controller
from tactuator.io.atomic import atomic_folder, write_text
from tactuator.speech.waveforms import CUTANEOUS, KINESTHETIC, MIDDLE, WaveformSet, WrittenWaveform, write_waveforms

PROTOCOL = "protocol.toml"


def run(
    out: Path,
    display: Path | None,
    controller: Path | None,
    duration: float,
    level: float,
    fingers: str,
    repetitions: int,
    seed: int,
    as_json: bool,
) -> None:
    """Write kinesthetic, middle and cutaneous waveforms, singly and combined, and a protocol to ask for them."""
    chosen = chosen_controller(display, controller)
    groups = tuple(tuple(group.split("+")) for group in fingers.split(","))
    components = tuple(replace(one, level_db_sl=level) for one in (KINESTHETIC, MIDDLE, CUTANEOUS))
    made = WaveformSet(duration, components=components, fingers=groups)
    own = {f"{label}.{ending}" for label in made.labels() for ending in ("wav", "json")} | {PROTOCOL}
    with atomic_folder(out, frozenset(own)) as beside:
        with working("rendering waveforms"):
            made_ones = write_waveforms(made, chosen, beside)
        write_text(beside / PROTOCOL, _protocol(made_ones, duration, repetitions, seed))
    table = Table("waveform", "limiter", title="Waveforms")
    for one in made_ones:
        table.add_row(one.label, f"{one.max_reduction_db:.1f} dB" if one.max_reduction_db else "untouched")
    items = [{"label": one.label, "file": one.path.name, "max_reduction_db": one.max_reduction_db} for one in made_ones]
    shown = Group(table, *written(out, out / PROTOCOL))
    answer({"out": str(out), "protocol": str(out / PROTOCOL), "items": items}, as_json, shown)


def _protocol(written: tuple[WrittenWaveform, ...], duration_s: float, repetitions: int, seed: int) -> str:
    keys = [*string.digits[1:], *string.ascii_lowercase, *string.ascii_uppercase]
    keys += [f"{number}" for number in range(10, 1000)]
    items = "".join(
        f'\n[[item]]\nlabel = "{one.label}"\nfile = "{one.path.name}"\nkey = "{key}"\n'
        for one, key in zip(written, keys, strict=False)
    )
    return (
        f'[study]\nname = "waveforms of {1e3 * duration_s:g} ms"\nseed = {seed}\n\n'
        '[recognition]\nparadigm = "recognition"\nlead_s = 0.3\ngap_s = 0.3\n'
        f'{items}\n[[block]]\nkind = "training"\nrepetitions = 2\nfeedback = true\n'
        f'\n[[block]]\nkind = "test"\nrepetitions = {repetitions}\nfeedback = false\n'
        '\n[[subject]]\ncode = "S1"\n'
    )

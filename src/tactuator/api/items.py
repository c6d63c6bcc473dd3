"""Items to recognise, and the protocol of an experiment that asks for them: waveforms, phonemes."""

import string
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from tactuator.api.option import Option
from tactuator.api.parameters import ControllerOption, DisplayOption, Place, Seed, chosen_controller
from tactuator.api.progress import working
from tactuator.errors import given_as
from tactuator.io.atomic import atomic_folder
from tactuator.result import Column, Fact, Result, found, rows_of
from tactuator.speech.items import (
    CUTANEOUS,
    KINESTHETIC,
    MIDDLE,
    WaveformSet,
    WrittenItem,
    write_phonemes,
    write_waveforms,
)
from tactuator.speech.options import LEVEL_DB_SL
from tactuator.speech.taps import CODES, layout_notes, read_layout, usual_layout

PROTOCOL = "protocol.toml"
LAYOUT_HELP = "Of phonemes: CSV of tactor (1 to 24) and channel (a name)."

Items = Annotated[Place, Option("Folder for the references and protocol.toml.", type=Path)]
Repetitions = Annotated[int, Option("Of each item in the test.", ge=1)]


@dataclass(frozen=True, eq=False, repr=False)
class ItemsResult(Result):
    """References in a folder, and the protocol that asks for them. notes: what is to be known of the set."""

    out: Path
    items: tuple[WrittenItem, ...]
    notes: tuple[str, ...] = ()

    def notices(self) -> Sequence[str]:
        return self.notes

    def table(self) -> Sequence[Column]:
        return [
            Column("label", [item.label for item in self.items], "item"),
            Column("file", [item.path.name for item in self.items]),
            Column("max_reduction_db", [item.max_reduction_db for item in self.items], "limiter", _limited),
        ]

    def facts(self) -> Sequence[Fact]:
        items = rows_of(self.table())
        limited = sum(item.max_reduction_db > 0.0 for item in self.items)
        return [
            Fact("out", self.out, "folder", summary=True),
            Fact("protocol", self.out / PROTOCOL, "protocol", summary=True),
            Fact("items", items),
            Fact("notes", list(self.notes)),
            found("references", len(items)),
            found("of them limited", limited),
        ]

    def next_step(self) -> str:
        return f"tactuator experiment recognise {self.out / PROTOCOL} --store answers.db"


def _limited(reduction_db: float) -> str:
    return f"{reduction_db:.1f} dB" if reduction_db else "not needed"


def waveforms(
    out: Items,
    controller: ControllerOption = None,
    *,
    display: DisplayOption = None,
    duration: Annotated[float, Option("Of every waveform, seconds.")] = 0.5,
    level: Annotated[float, Option("Of every component, dB SL.")] = 40.0,
    fingers: Annotated[str, Option("Groups: names with +, groups with commas.")] = "thumb,index,middle,all",
    repetitions: Repetitions = 10,
    seed: Seed = 0,
) -> ItemsResult:
    """Write waveforms and a protocol that asks for them. They are kinesthetic, middle and cutaneous, singly and
    combined.

    Raises BadInput for a finger that the display does not have.

    >>> len(tt.waveforms("waves", controller, fingers="thumb").items)
    7
    """
    loaded = chosen_controller(display, controller)
    groups = tuple(tuple(group.split("+")) for group in fingers.split(","))
    with given_as("level_db_sl", "level"):
        components = tuple(replace(component, level_db_sl=level) for component in (KINESTHETIC, MIDDLE, CUTANEOUS))
    waveform_set = WaveformSet(duration, components=components, fingers=groups)
    with _folder(out, waveform_set.labels()) as beside:
        with working("rendering waveforms"):
            written = write_waveforms(waveform_set, loaded, beside)
        study = f"waveforms of {1e3 * duration:g} ms"
        (beside / PROTOCOL).write_text(recognition_protocol(study, written, repetitions, seed), encoding="utf-8")
    return ItemsResult(Path(out), written)


def phonemes(
    out: Items,
    controller: ControllerOption = None,
    *,
    display: DisplayOption = None,
    level: Annotated[float, Option("Of every burst, dB SL.")] = LEVEL_DB_SL,
    layout: Annotated[Place | None, Option(LAYOUT_HELP, file=True)] = None,
    repetitions: Repetitions = 4,
    seed: Seed = 0,
) -> ItemsResult:
    """Write TAPS's phonemes and a protocol for them. There are 39; up to six channels get a reduced code.

    Raises BadInput for a layout that does not fit the display.
    """
    loaded = chosen_controller(display, controller)
    channels = tuple(channel.name for channel in loaded.display.channels)
    placed = usual_layout(len(channels)) if layout is None else read_layout(Path(layout), channels)
    with _folder(out, CODES) as beside:
        with working("coding phonemes"), given_as("level_db_sl", "level"):
            written = write_phonemes(loaded, level, placed, beside)
        protocol = recognition_protocol("phonemes by TAPS", written, repetitions, seed)
        (beside / PROTOCOL).write_text(protocol, encoding="utf-8")
    return ItemsResult(Path(out), written, layout_notes(placed))


def _folder(out: Place, labels: Mapping[str, Any]) -> AbstractContextManager[Path]:
    return atomic_folder(
        out, frozenset({f"{label}.{ending}" for label in labels for ending in ("wav", "json")} | {PROTOCOL})
    )


def recognition_protocol(study: str, items: Sequence[WrittenItem], repetitions: int, seed: int) -> str:
    """Return the protocol of a recognition experiment over items."""
    keys = [*string.digits[1:], *string.ascii_lowercase, *string.ascii_uppercase]
    keys += [f"{number}" for number in range(10, 1000)]
    listed = "".join(
        f'\n[[item]]\nlabel = "{item.label}"\nfile = "{item.path.name}"\nkey = "{key}"\n'
        for item, key in zip(items, keys, strict=False)
    )
    return (
        f'[study]\nname = "{study}"\nseed = {seed}\n\n'
        '[recognition]\nparadigm = "recognition"\nlead_s = 0.3\ngap_s = 0.3\n'
        f'{listed}\n[[block]]\nkind = "training"\nrepetitions = 2\nfeedback = true\n'
        f'\n[[block]]\nkind = "test"\nrepetitions = {repetitions}\nfeedback = false\n'
        '\n[[subject]]\ncode = "S1"\n'
    )

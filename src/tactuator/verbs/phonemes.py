"""The verb that codes phonemes for tactors, as TAPS does, in dB SL."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tactuator.errors import BadInput
from tactuator.speech.options import LEVEL_DB_SL
from tactuator.table import ResultTable
from tactuator.verbs.parameters import Argument, ControllerOption, DisplayOption, Option, Place, chosen_controller
from tactuator.verbs.pattern import MOST_LOSS_DB
from tactuator.verbs.result import Result, columns_of, figure, plain, working
from tactuator.verbs.speech import PROTOCOL, recognition_protocol

if TYPE_CHECKING:
    from tactuator.patterns.taps import CodedPhonemes

ALL = "all"
REPETITIONS = 4


@dataclass(frozen=True, eq=False, repr=False)
class PhonemesResult(Result):
    """Phonemes as references. written: the references; levels: of each phoneme, dB SL, by one digital gain and as
    designed."""

    out: Path
    written: "Mapping[Path, CodedPhonemes]"
    level_db_sl: float
    most_loss_db: float
    levels: Mapping[str, tuple[float, float]]

    @property
    def _worst_db(self) -> float:
        return max(coded.loss.shortfall_db_sl for coded in self.written.values())

    @property
    def holds(self) -> bool:
        return self._worst_db <= self.most_loss_db

    def _shown(self) -> list[str]:
        return list(dict.fromkeys(each.name for coded in self.written.values() for each in coded.spoken))

    def headline(self) -> Mapping[str, str]:
        count = sum(len(coded.spoken) for coded in self.written.values())
        short = figure(self._worst_db, "dB", 3)
        return {"written": str(self.out), "phonemes": str(count), "short by up to": short}

    def notices(self) -> Sequence[str]:
        coded = next(iter(self.written.values()))
        channels = len(coded.head.channels)
        reduced = f"a reduced code: 24 tactors on {channels} channels" if len(set(coded.head.channels)) < 24 else ""
        same = "; ".join(", ".join(names) for names in coded.alike)
        longest_s = max(each.delayed_s for each in self.written.values())
        return tuple(line for line in (
            reduced,
            f"these are felt alike: {same}" if same else "",
            f"codes wait for the one before by up to {longest_s:.2f} s" if longest_s > 0.0 else "",
            *(f"the carrier of {hertz:g} Hz is moved into the display's band" for hertz in coded.moved),
        ) if line)  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        references = [
            {"out": str(path), "phonemes": [asdict(each) for each in coded.spoken], "delayed_s": coded.delayed_s,
             "loss": plain(coded.loss.document())}
            for path, coded in self.written.items()
        ]  # fmt: skip
        coded = next(iter(self.written.values()))
        levels = [
            {"phoneme": name, "one_gain_db_sl": first, "designed_db_sl": last}
            for name, (first, last) in self.levels.items()
        ]
        return {
            "out": str(self.out), "level_db_sl": self.level_db_sl, "references": references, "levels": levels,
            "alike": coded.alike, "layout": coded.head.provenance["layout"], "most_loss_db": self.most_loss_db,
            "met": self.holds,
        }  # fmt: skip

    def columns(self) -> Mapping[str, Any]:
        rows = ((name, *levels) for name, levels in self.levels.items())
        return columns_of(("phoneme", "one_gain_db_sl", "designed_db_sl"), rows)

    def tables(self) -> Sequence[ResultTable | str]:
        rows = tuple((name, f"{self.levels[name][0]:.1f}", f"{self.levels[name][1]:.1f}") for name in self._shown())
        spread = [f"{max(levels) - min(levels):.1f}" for levels in zip(*self.levels.values(), strict=True)]
        columns = ("phoneme", "dB SL by one digital gain", f"dB SL as designed (asked: {self.level_db_sl:g})")
        table = ResultTable("Felt level by the display's model", columns, (*rows, ("spread of all 39", *spread)))
        return [table, f"the display falls short by up to {self._worst_db:.1f} dB (allowed: {self.most_loss_db:g})"]


def phonemes(
    spoken: Annotated[str, Argument('"HH AH L OW", .TextGrid, .csv (phoneme, start_s), .txt, or all: a set to learn.')],
    controller: ControllerOption,
    out: Annotated[Place, Option("Reference to write: .wav or .h5; of all, a folder with a protocol.", writes=True)],
    level_db_sl: Annotated[float, Option("Of every burst, dB SL.", ("--level",))] = LEVEL_DB_SL,
    *,
    display: DisplayOption = None,
    notation: Annotated[str, Option("arpabet, or taps: TAPS's own names.")] = "arpabet",
    layout: Annotated[Place | None, Option("CSV of tactor (1 to 24) and channel (a name).", file=True)] = None,
    spacing_s: Annotated[float, Option("Least silence between two codes.", ge=0, le=10)] = 0.05,
    most_loss_db: Annotated[float, Option("Shortfall that is allowed, dB.", ("--most-loss",), ge=0)] = MOST_LOSS_DB,
) -> PhonemesResult:
    """Code phonemes onto 24 tactors or fewer, as TAPS does. Every burst has the same level in dB SL on its own tactor;
    up to six channels get a reduced code, one for each part of the arm.

    Holds where the display falls short by no more than `most_loss_db`. Raises BadInput for what is no phoneme, another
    notation, or a layout that does not fit the display.

    >>> tt.phonemes("HH AH L OW", controller, "hello.wav")
    <Phonemes written: hello.wav, phonemes: 4, short by up to: 0 dB>
    """
    from tactuator.io.atomic import atomic_folder, write_text
    from tactuator.patterns.taps import CODES, SpokenPhoneme, code_phonemes, felt_levels_db, phonemes_of, usual_layout

    loaded, target = chosen_controller(display, controller), Path(out)
    channels = tuple(channel.name for channel in loaded.display.channels)
    placed = usual_layout(len(channels)) if layout is None else _read_layout(Path(layout), channels)
    levels = felt_levels_db(loaded, level_db_sl, placed)
    if spoken != ALL:
        coded = code_phonemes(phonemes_of(spoken, notation), loaded, level_db_sl, placed, spacing_s)
        _write(target, coded)
        return PhonemesResult(target, {target: coded}, level_db_sl, most_loss_db, levels)
    names = {f"{name}.{ending}" for name in CODES for ending in ("wav", "json")} | {PROTOCOL}
    with atomic_folder(target, frozenset(names)) as beside, working("coding phonemes", len(CODES)) as step:
        each = {}
        for number, name in enumerate(CODES):
            step(number)
            each[Path(f"{name}.wav")] = code_phonemes((SpokenPhoneme(name),), loaded, level_db_sl, placed, spacing_s)
            _write(beside / f"{name}.wav", each[Path(f"{name}.wav")])
        items = [(name, f"{name}.wav") for name in CODES]
        write_text(beside / PROTOCOL, recognition_protocol("phonemes by TAPS", items, REPETITIONS, 0))
    return PhonemesResult(
        target, {target / path: coded for path, coded in each.items()}, level_db_sl, most_loss_db, levels
    )


def _write(path: Path, coded: "CodedPhonemes") -> None:
    from tactuator.io.reference import write_reference

    with write_reference(path, coded.head, len(coded.reference)) as writer:
        writer.write(coded.reference)


def _read_layout(path: Path, channels: tuple[str, ...]) -> tuple[int, ...]:
    """Return the channel of each tactor. Raises BadInput unless each of the 24 has one of the display's."""
    from tactuator.io.text import read_text

    rows = list(csv.DictReader(read_text(path).splitlines()))
    try:
        named = {int(row["tactor"]): row["channel"].strip() for row in rows}
        layout = tuple(channels.index(named[tactor]) for tactor in range(1, 25))
        if len(rows) != len(layout):
            raise ValueError
    except (KeyError, ValueError, TypeError, AttributeError):
        allowed = f"columns tactor and channel, each tactor of 1 to 24 once, on {', '.join(channels)}"
        raise BadInput("a layout that is none", allowed, where=(str(path),)) from None
    return layout

"""Programs for emulated boards in which one line of the sources is altered, and nothing else.

The unaltered sources are compiled once for each board; of an alteration only the file, or, of an altered header, those
that name a function or a constant of it, if only in another header's function.
"""

import re
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

from firmware.build import ROOT, Board, compile_command, sources


@dataclass(frozen=True)
class Mutant:
    """`old` becomes `new` in `path`, where it stands once. adaptive: the board is checked with a controller that feeds
    a finger forward."""

    name: str
    path: str
    old: str
    new: str
    adaptive: bool = False


_DEFINED = re.compile(r"^static inline [^;{(]*?(\w+)\(|^#define (\w+)", re.MULTILINE)


def _defined(text: str) -> set[str]:
    return {name for pair in _DEFINED.findall(text) for name in pair if name}


def _names_any(text: str, names: set[str]) -> bool:
    return not names.isdisjoint(re.findall(r"\w+", text))


@dataclass
class Bench:
    """A copy of the sources in `folder`, with the objects of a board's unaltered program."""

    board: Board
    folder: Path
    flags: list[str] = field(default_factory=list)
    tail: list[str] = field(default_factory=list)
    read_by: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for part in ("core", "firmware", "tests/firmware/emulated"):
            shutil.copytree(ROOT / part, self.folder / part)
        command = compile_command(self.board, sources(self.board), "PROGRAM")
        at = next(at for at, word in enumerate(command) if word.startswith("-T"))
        self.flags = [word for word in command[:at] if not word.endswith(".c")]
        self.tail = command[at:-2]
        for path in (word for word in command if word.endswith(".c")):
            self._compile(path, "-MMD", "-MF", "needed")
            needed = (self.folder / "needed").read_text().replace("\\\n", " ").split()[1:]
            for each in needed:
                self.read_by.setdefault(each, []).append(path)

    def program(self, mutant: Mutant) -> Path:
        """The altered program; the copy is as it was before afterwards."""
        source = self.folder / mutant.path
        original = source.read_text()
        assert original.count(mutant.old) == 1, f"{mutant.name}: stands {original.count(mutant.old)} times"
        again = self._changed_by(mutant.path)
        kept = {path: self._object(path).read_bytes() for path in again}
        out = self.folder / f"{mutant.name.replace(' ', '-')}.elf"
        source.write_text(original.replace(mutant.old, mutant.new))
        try:
            for path in again:
                self._compile(path)
            self._link(out)
        finally:
            source.write_text(original)
            for path, unaltered in kept.items():
                self._object(path).write_bytes(unaltered)
        return out

    def _changed_by(self, path: str) -> list[str]:
        if path.endswith(".c"):
            return [path]
        names, before = _defined((self.folder / path).read_text()), 0
        headers = [(self.folder / each).read_text() for each in self.read_by if each.endswith(".h")]
        while len(names) > before:
            before = len(names)
            for text in headers:
                names |= _defined(text) if _names_any(text, names) else set()
        return [each for each in self.read_by[path] if _names_any((self.folder / each).read_text(), names)]

    def _object(self, path: str) -> Path:
        return self.folder / (path.replace("/", "-") + ".o")

    def _compile(self, path: str, *more: str) -> None:
        self._run([*self.flags, *more, "-c", path, "-o", str(self._object(path))])

    def _link(self, out: Path) -> None:
        every = sorted({path for readers in self.read_by.values() for path in readers})
        self._run([*self.flags, *(str(self._object(path)) for path in every), *self.tail, "-o", str(out)])

    def _run(self, command: list[str]) -> None:
        done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-2000:]


_PERIOD, _BOARD, _GUARD, _RUN = (f"core/board/{name}" for name in ("period.c", "board.c", "guard.h", "run.c"))
_LEARNING, _FED, _CONTROL = "core/touch/learning.c", "core/touch/feed_forward.h", "core/control/controller.h"

FEW = (
    Mutant("command doubled", _PERIOD, "const float command_v = board->command_fade * answer_v;",
           "const float command_v = 2.0f * board->command_fade * answer_v;"),
    Mutant("limits of the guard off", _GUARD,
           "if (!(place <= safety->stop_max_v && off <= safety->disagreement_v)) {", "if (0) {"),
    Mutant("reference not within comfort", "core/board/stream.c",
           "tact_board_within(want, safety->reference_max)", "want"),
    Mutant("code not rounded", "core/arithmetic/converter.h", "vcvtr.s32.f32", "vcvt.s32.f32"),
    Mutant("command not faded", _PERIOD, "const float command_v = board->command_fade * answer_v;",
           "const float command_v = answer_v;"),
    Mutant("one sample of delay less", _PERIOD, "board->delay_at + 1 < board->safety.delay_samples",
           "board->delay_at + 2 < board->safety.delay_samples"),
    Mutant("nothing put out", "firmware/main.c", "    tact_port_put_out(codes);\n", ""),
    Mutant("stop begins the soft start anew", _RUN, "        leave(board, TACT_FADES);\n    return",
           "        board->fade < 1.0f ? fade_in(board) : (void)0, leave(board, TACT_FADES);\n    return"),
    Mutant("ring of a finger's delay one short", _FED, "state->at + 1 < table->delay", "state->at + 2 < table->delay",
           adaptive=True),
)  # fmt: skip

_TOUCH = (
    ("finger fed forward by a difference", _FED, "command_v + (state->by_change", "command_v - (state->by_change"),
    ("fed forward without a bound", _FED, "if (__builtin_fabsf(added_v) <= table->push_max_v)", "if (1)"),
    ("unloaded plant without drag", _LEARNING, "second * rest[0] - first * mass[1];", "second * rest[0];"),
    ("learns at every tick", _FED, "--state->left <= 0", "--state->left <= 99"),
    ("weights leap", _LEARNING, "from + within(to - from, -slew, slew)", "slew > 0.0f ? to : from"),
    ("hum not taken off", _LEARNING, "force - turn_hum(table, state)", "force - 0.0f * turn_hum(table, state)"),
    ("nothing fades in silence", _LEARNING, "1.0f - table->fading * (1.0f - share)", "1.0f"),
    ("nothing fed forward", _CONTROL, "wanted += tact_touch_step(", "wanted += 0.0f * tact_touch_step("),
    ("force of another sign", _FED, "- by_y[0] * position_v;", "+ by_y[0] * position_v;"),
    ("learnt things kept", "core/touch/table.c", "    forget(table, state);\n}",
     "    (void)forget;\n    (void)table;\n}"),
)  # fmt: skip

MANY = (
    *(Mutant(*each, adaptive=True) for each in _TOUCH),
    # the period
    Mutant("no place of rest", _GUARD, "(moved + safety->stop_lead * next) + half", "moved + half"),
    Mutant("comfort fades slowly", _RUN, "fault == TACT_FAULT_COMFORT ? TACT_RAMPS_QUICKLY : TACT_CUT",
           "fault == TACT_FAULT_COMFORT ? TACT_FADES : TACT_CUT"),
    Mutant("frozen a tick later", "core/board/guard.c", "state->changed_tick >= (uint32_t)safety->frozen_ticks",
           "state->changed_tick > (uint32_t)safety->frozen_ticks"),
    Mutant("fade never ends", _RUN, "board->fade += board->fade_step;", "board->fade += 0.0f;"),
    Mutant("offset forgotten", _PERIOD, "(command_v - converter->offset_v_single)", "command_v"),
    Mutant("cut to code zero", _BOARD, "= board->safety.channel[channel].converter.rest_code & 0xffffff;", "= 0;"),
    Mutant("reference not faded", _PERIOD, "state, board->fade * want, position_v)", "state, want, position_v)"),
    Mutant("command beyond its limit", _CONTROL, "if (state->clamped | state->broken)", "if (0)"),
    Mutant("driven beyond its limit", _PERIOD, "tact_board_within(want, board->safety.channel[c].command_max_v)",
           "want"),
    Mutant("stream by another row", _PERIOD, "board->stream + (size_t)((board->tick &",
           "board->stream + (size_t)(((board->tick + 1u) &"),
    Mutant("fault ends at once", _PERIOD, "(board->mode == TACT_FAULT && board->command_fade > 0.0f)", "0"),
    # the board
    Mutant("cut after the queue", _RUN, "    board->cuts++;\n    tact_board_empty_queue(board, channel);",
           "    board->cuts++;"),
    Mutant("mildest fault first", _RUN, "int32_t fault = TACT_FAULT_LAST; fault > TACT_FAULT_NONE; fault--",
           "int32_t fault = TACT_FAULT_NONE + 1; fault <= TACT_FAULT_LAST; fault++"),
    Mutant("controller goes on", _RUN,
           "tact_controller_reset(&board->image.controller[c], &board->channel[c].controller);", ";"),
    Mutant("reach without the offset", "core/board/safety.c", "- __builtin_fabsf(converter->offset_v_single);", ";"),
    Mutant("limit of the image alone", _BOARD,
           "table->command_max_v = table->command_max_v < most ? table->command_max_v : most;", "(void)most;"),
    Mutant("travel on one side", "core/board/stream.c", "below < low ? low : below", "below"),
    Mutant("slow part of another share", "core/board/stream.c",
           "share * (limited - slow);", "share * (want - slow);"),
    Mutant("armed after any faults", _BOARD, "|| tact_board_is_locked(board))\n        return 0;",
           ")\n        return 0;"),
    # the guard
    Mutant("force of a finger forgotten", "core/board/guard.c", "safety->correct_w + safety->damp * safety->correct_x",
           "safety->correct_w"),
    Mutant("stray without the balance", "core/board/guard.c", "(unexplained - state->balance)", "unexplained"),
    Mutant("jump as far as it likes", "core/board/guard.c", "!(jump <= safety->jump_v)", "0"),
    Mutant("standing still goes on", _RUN, "        tact_guard_begin(&board->channel[c].guard);\n", ""),
    Mutant("reading and model apart", _GUARD, "+ half) + 0.5f * off;", "+ half);"),
    Mutant("comfort not compared", "core/board/guard.c", "if (!(__builtin_fabsf(felt) <= safety->comfort_max))",
           "if (0)"),
    Mutant("open on one side", "core/board/guard.c", "code < -safety->position_code_max", "0"),
    Mutant("frozen at once", "core/board/guard.c", "SAME_TICKS_OF_A_FROZEN_ONE = 8", "SAME_TICKS_OF_A_FROZEN_ONE = 1"),
    # arithmetic, conversions, controllers
    Mutant("section of another sign", "core/arithmetic/section.h",
           "state->s2 = s2 + (section->b2 * x - section->a2 * y);",
           "state->s2 = s2 + (section->b2 * x + section->a2 * y);"),
    Mutant("half an anti-windup", "core/control/controller.c", "    last->s2 += table->anti_windup[1] * missing;\n",
           ""),
    Mutant("ramp of a tone", "core/board/stimulus.c", "0.5f * (1.0f - state->ramp_cosine)",
           "0.5f * (1.0f + state->ramp_cosine)"),
    # outside the core
    Mutant("late and nobody told", "firmware/main.c", "tact_period_step(&board, codes, tact_port_lateness());",
           "tact_period_step(&board, codes, 255u);"),
)  # fmt: skip

"""Commands of the verbs' signatures, their reference and answers; promises of the command line; Ctrl-C as it loads."""

import ast
import inspect
import json
import os
import re
import signal
import subprocess
import sys
import time
import types
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Annotated, get_args, get_origin

import numpy as np
import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from rich.segment import Segments

import tactuator
from tactuator.api.option import Argument, Option
from tactuator.api.parameters import RIG_HELP
from tactuator.api.progress import watched, working
from tactuator.cli import output
from tactuator.cli.command import command_of
from tactuator.cli.commands import COMMANDS as TABLE
from tactuator.cli.commands import FIRST, Command, top_commands
from tactuator.cli.main import build_app
from tactuator.cli.output import Bars, answer, drawn
from tactuator.entry_points import plugins
from tactuator.errors import BadInput
from tactuator.io.shipped import EXAMPLES
from tactuator.plain import finite, with_error
from tactuator.result import Fact, Result, ResultTable, data, found
from tactuator.rig.open import RIGS
from tools.cli_reference import PAGE, reference, sorted_commands

HEAVY = ("numpy", "scipy", "h5py", "matplotlib", "soundfile", "sqlalchemy", "fastapi", "rich")
COMMANDS = list(sorted_commands(typer.main.get_command(build_app()), ("tactuator",)))
KINDS = {str, int, float, bool, Path, list, type(None)}


def test_commands__each__have_known_types_and_stand_in_the_reference() -> None:
    for name, command in TABLE.items():
        function = command.function()
        for parameter in inspect.signature(command_of(function)).parameters.values():
            kinds = get_args(parameter.annotation) or (parameter.annotation,)
            assert {get_origin(kind) or kind for kind in kinds} <= KINDS, parameter
        assert " ".join((inspect.getdoc(function) or "").split()).startswith(command.sentence), name
        assert len(command.sentence) <= 57, name
    assert PAGE.read_text(encoding="utf-8") == reference(), "out of date: make docs"
    for path, command in COMMANDS:
        assert (command.help or "").strip(), path
        for parameter in command.params:
            assert (getattr(parameter, "help", None) or "").strip(), (path, parameter.name)
        assert path[-1] in ("serve", "console") or any("--json" in each.opts for each in command.params), path
    kinds = {name for name, point in plugins(RIGS).items() if point.value.startswith("tactuator.")}
    assert {name.partition(":")[0] for name in RIG_HELP.removeprefix("Rig: ").rstrip(".").split(", ")} == kinds


def test_help__of_each_command_and_option__is_in_sentences_of_the_shell() -> None:
    for path, command in COMMANDS:
        assert not re.search("Raises|`holds`|BadInput", command.help or ""), path
        for parameter in command.params:
            about = getattr(parameter, "help", None) or ""
            assert re.fullmatch(r"[A-Z0-9`].*[.]", about, re.DOTALL), (path, parameter.name, about)
            if parameter.param_type_name == "option":
                assert about.endswith("Repeatable.") == parameter.multiple, (path, parameter.name, about)


def named(
    level_db_sl: Annotated[float, Option("Level.", ("--level-db-sl", "--level"))] = 0.0,
    friction: Annotated[bool, Option("Friction.", ("--friction/--no-friction",))] = True,
    display: Annotated[str, Argument("Display.")] = "",
    given: Annotated[str, Option("Where.")] = "",
) -> Result:
    """Refuse. With `friction`; `holds` is False if not met. `holds` is False, too."""
    if level_db_sl:
        error = BadInput("loud", key="level_db_sl", where=(given,) if given else ())
        error.add_note("a lower `level_db_sl`")
        raise error
    return Answer({}, "`friction` of `display`, not `hold`", ResultTable("", ("a",), (("`given`",),), ("`friction`",)))


def test_parameter__named_in_an_error_a_result_or_a_docstring__is_spelled_as_typed(capsys) -> None:
    run = command_of(named)
    assert run.__doc__ == "Refuse. With --friction; exit status 1 if not met. Exit status 1, too."
    with pytest.raises(BadInput) as refused:
        run(level_db_sl=1.0, friction=True, display="", given="", as_json=False, full=False)
    assert refused.value.lines == ["--level is loud", "a lower --level"]
    with pytest.raises(BadInput, match=r"a\.toml: level_db_sl is loud"):  # the key of a file
        run(level_db_sl=1.0, friction=True, display="", given="a.toml", as_json=False, full=False)
    run(level_db_sl=0.0, friction=True, display="", given="", as_json=False, full=True)
    assert [line.strip() for line in capsys.readouterr().out.splitlines() if line.strip(" ─")] == [
        "--friction of display, not `hold`", "a", "--given", "--friction",
    ]  # fmt: skip


def test_errors__of_all_modules__name_parameters_but_in_whole_commands() -> None:
    for path in Path(tactuator.__file__).parent.rglob("*.py"):
        if path.parent.name == "cli":
            continue
        raised = (
            ast.unparse(call)
            for call in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "BadInput"
        )
        spelled = [text for text in raised if re.search("--[a-z]", re.sub("`[^`]* [^`]*`", "", text))]
        assert spelled == [], path


def test_help__of_all_commands_and_version__import_nothing_heavy() -> None:
    program = (
        "import sys; from tactuator.cli import main; status = main(sys.argv[2:]); "
        "sys.exit(repr(set(sys.argv[1].split()) & set(sys.modules)) if status == 0 else 'failed')"
    )
    for asked in ("--help", "--version"):
        words = [sys.executable, "-c", program, " ".join(HEAVY), asked]
        assert subprocess.run(words, capture_output=True, text=True, check=False).stderr == "set()\n"


def test_file_that_is_missing__is_told_in_one_line(run) -> None:
    run.refused("identify", "no.csv", said="records no.csv: file not found")


def completed(shell: str, line: str) -> str:
    words = line.split(" ")
    said = {"_TACTUATOR_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_ARGS": line,
            "COMP_WORDS": "\n".join(words), "COMP_CWORD": str(len(words) - 1),
            "_TYPER_COMPLETE_FISH_ACTION": "get-args"}  # fmt: skip
    program = [sys.executable, "-m", "tactuator"]
    return subprocess.run(program, env={**os.environ, **said}, capture_output=True, text=True, check=False).stdout


@pytest.mark.parametrize(
    ("out", "words"),
    [("nowhere/x.h5", "nowhere is not a folder"), ("x.xyz", "ending '.xyz'; expected .h5, .hdf5, .csv")],
)
def test_measure__out_that_cannot_be_written__is_refused_before_all_else(run, tmp_path, out, words) -> None:
    (controller := tmp_path / "controller.json").write_text("none")
    status, _, err = run("measure", "response", "--controller", str(controller), "--out", out)
    assert status == 2
    assert words in err


def test_completion__of_a_verb_a_part_and_an_option__in_every_shell() -> None:
    assert "design" in completed("zsh", "tactuator des")
    assert "thresholds" in completed("fish", "tactuator experiment thr")
    assert "--figures" in completed("bash", "tactuator design --fig")
    script = (
        'eval "$(_TACTUATOR_COMPLETE=source_bash tactuator)"; COMP_WORDS=(tactuator sound calibrate-); COMP_CWORD=2; '
        '_tactuator_completion tactuator; echo "${COMPREPLY[@]}"'
    )
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    done = subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["calibrate-display"]


def test_help__of_everything__has_the_first_verbs_at_the_top_and_each_in_one_line(run, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    shown = run("--help").out
    verbs = [*FIRST, *(verb for verb in top_commands() if verb not in FIRST)]
    said = [line.split() for line in shown.splitlines() if line.startswith("  ") and line.split()[0] in verbs]
    assert [words[0] for words in said] == verbs
    assert all(words[-1].endswith(".") for words in said)
    assert "…" not in shown


@dataclass(frozen=True)
class Margin:
    phase_deg: float
    levels_db: np.ndarray


class Answer(Result):
    """A result with what is printed of it."""

    def __init__(self, document: dict[str, object], *shown: ResultTable | str) -> None:
        self.document, self.shown = document, shown

    def facts(self) -> Sequence[Fact]:
        return data(self.document)

    def tables(self) -> Sequence[ResultTable | str]:
        return self.shown


class Long(Result):
    """A result of a display with many channels."""

    def facts(self) -> Sequence[Fact]:
        return [found(f"channel {number}", "felt within 0.31 dB of 40 dB SL " * 4) for number in range(24)]

    def next_step(self) -> str:
        return "tactuator build"


def test_answer__as_json_or_for_a_person__one_object_or_tables(capsys):
    found_ones = {"ok": True, "levels_db": np.array([1.5, np.inf]), "path": Path("a/b"), "name": "µ"}
    answer(Answer(found_ones, "no"), True, False)
    assert capsys.readouterr() == ('{"ok": true, "levels_db": [1.5, null], "path": "a/b", "name": "µ"}\n', "")
    table = ResultTable("", ("frequency", "level"), (("10 Hz", "50 dB SL"),), ("a note",))
    answer(Answer({}, "level [dB SL]", table), False, True, ["f.csv"])
    out = capsys.readouterr().out
    assert out.startswith("level [dB SL]\n")  # brackets are text
    assert "50 dB SL" in out
    assert out.endswith("a note\nwritten: f.csv\n")
    answer(Answer({}, table), False, False, ["f.csv"])
    assert capsys.readouterr().out == "written: f.csv\n"
    with watched(Bars()), working("counting", 3) as step:
        step(1, text="one")
    assert capsys.readouterr() == ("", "")


def test_long_work__where_no_terminal_is__writes_a_line_now_and_then(capsys, monkeypatch):
    monkeypatch.setattr(output, "EVERY_S", 0.01)
    written = ""
    with watched(Bars()), working("identifying", 1.0) as before, working("designing") as step, working("checking"):
        before(1.0)
        step(text="index")
        while "tactuator: index, 0.0" not in written:  # pytest's own time limit ends it
            written += capsys.readouterr().err
    assert "checking" not in written


@pytest.mark.parametrize("width", [40, 80, 200])
def test_summary__of_many_channels__has_ten_lines_no_wider_than_the_terminal(width: int, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    result = Long()
    answer(result, False, False, ["controller.json"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 10
    assert max(map(len, lines)) <= width
    assert lines[-3:] == ["more: --full", "next: tactuator build", "written: controller.json"]
    assert str(result).splitlines()[-1] == "more: to_dict()"  # in Python
    whole = [" ".join(f"{fact.words}: {fact.text}".split()) for fact in result.facts()]
    shown = " ".join(" ".join(lines[:-3]).split())
    assert shown in {" ".join(whole[:count]) for count in range(1, 24)}


@pytest.mark.parametrize(
    ("texts", "kept"),
    [
        (["a", "b " * 500, "c"], ["0: a"]),
        (["b " * 500, "c"], ["1: c"]),
        (["a", "why; " + "b " * 500 + "; c"], ["0: a", "1: why"]),
    ],
    ids=["a finding too long", "the first too long", "at a semicolon"],
)
def test_summary__too_long__ends_between_findings_or_at_a_semicolon(texts: list[str], kept: list[str]) -> None:
    class Given(Result):
        def facts(self) -> Sequence[Fact]:
            return [found(f"{number}", text) for number, text in enumerate(texts)]

    assert Given().summary_lines([], 80, "--full") == [*kept, "more: --full"]


def test_summary__several_findings_of_one_name__are_all_printed() -> None:
    class Given(Result):
        def facts(self) -> Sequence[Fact]:
            return [found("it cannot", "one"), found("it cannot", "other")]

    assert Given().summary_lines() == ["it cannot: one", "it cannot: other"]


def test_plain__dataclass_and_complex__become_objects_and_pairs():
    assert finite(Margin(58.6, np.array([1.0]))) == {"phase_deg": 58.6, "levels_db": [1.0]}
    numbers = {1: np.complex64(1 + 2j), "n": np.int64(3), "t": (np.bool_(True), None)}
    assert finite(numbers) == {"1": [1.0, 2.0], "n": 3, "t": [True, None]}
    with pytest.raises(TypeError, match="set"):
        finite({"members": {1, 2}})


texts = st.text('a"\\/\n\0\x7fµ\u2028\ud800😀')  # all that JSON treats in a way of its own
values = st.recursive(
    st.none() | st.booleans() | st.integers() | texts | st.floats() | st.sampled_from([np.inf, -np.inf, np.nan]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
)


@given(values)
def test_plain__any_value__survives_strict_json(value):
    assert json.loads(json.dumps(finite(value), allow_nan=False)) == finite(value)


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (0.199196, 0.000243, ("0.19920", "0.00024")),
        (2739.95, 0.367, ("2739.95", "0.37")),
        (-31.812, 1.4, ("-31.8", "1.4")),
        (0.0, 0.0, ("0", "0")),
        (1.5, float("inf"), ("1.5", "inf")),
        (8.2572e7, 3.1e4, ("8.2572e+07", "3.1e+04")),
        (8.016e-9, 1.7e-11, ("8.016e-09", "1.7e-11")),
        (0.0, 3.0e-9, ("0", "3e-09")),
        (12.0, 250.0, ("12", "250")),
    ],
)
def test_with_error__value__has_the_digits_that_its_error_leaves(value, error, shown):
    assert with_error(value, error) == shown


@pytest.mark.parametrize("width", [60, 80, 160])
def test_shown__table_wider_than_the_terminal__loses_no_letter(width):
    columns = ("subject", "finger", "Hz", "trials", "procedure", "refit", "95 %", "dB re 1 µm", "flags")
    row = ("S1", "middle", "164.3", "129", "-12.5", "≥ 29.5", "8.5 to 54.2", "15.8", "chance, delivered-unknown")
    console = Console(width=width, record=True, file=StringIO())
    console.print(drawn(ResultTable("Thresholds", columns, (row,), ("a note",)), console))
    lines = console.export_text().splitlines()
    assert max(len(line) for line in lines) <= width
    letters, given_ones = Counter("".join(lines)), Counter("".join(columns + row).replace(" ", ""))
    assert all(letters[letter] >= count for letter, count in given_ones.items())
    assert "…" not in letters
    assert width < 80 or Counter(" ".join(columns + row).split()) <= Counter(" ".join(lines).split())  # words are whole


PROGRAM = Path(sys.executable).parent / "tactuator"


@pytest.fixture
def trial(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], None]], None]:

    def make(action: Callable[[], None]) -> None:
        module = types.ModuleType("tactuator.trial")

        def trial(
            rate_hz: Annotated[float, Option("Of the trial.")] = 1.0,
            file: Annotated[Path | None, Option("File to write.", writes=True)] = None,
        ) -> None:
            """Try."""
            action()

        module.trial = trial
        monkeypatch.setitem(sys.modules, "tactuator.trial", module)
        for name in [*TABLE]:
            monkeypatch.delitem(TABLE, name)
        monkeypatch.setitem(TABLE, "trial", Command("trial", "trial:trial", "Try.", "Trials"))

    return make


def test_main__version_no_arguments_or_no_part__are_told(run):
    assert run("--version") == (0, f"tactuator {tactuator.__version__}\n", "")
    assert "\n  design " in run().out
    run.refused("sound", said="sound: no subcommand is named; expected devices, latency, calibrate")


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (None, 0, ""),
        (typer.Exit(1), 1, ""),
        (BadInput("got this,\n  allowed is that"), 2, "tactuator: got this,\\n allowed is that\n"),
        (OSError(), 2, "tactuator: OSError\n"),
        (FileNotFoundError(2, "No such file", "out.txt"), 2, "tactuator: out.txt: No such file\n"),
        (KeyboardInterrupt(), 130, "tactuator: interrupted\n"),
    ],
    ids=["well", "verdict no", "bad input, two lines", "nameless", "unwritable", "Ctrl-C"],
)
def test_main__however_a_verb_ends__has_its_status_and_one_line(error, status, said, trial, run):
    def action() -> None:
        if error is not None:
            raise error

    trial(action)
    assert run("trial") == (status, "", said)


def test_main__own_fault__shows_the_traceback_and_is_no_verdict(trial, run):
    trial(lambda: 1 // 0)
    ended = run("trial")
    assert ended.status == 70
    assert "Traceback" in ended.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("zzz", "no command 'zzz'; expected trial"),
        ("trail", "'trail' (did you mean 'trial'?)"),
        ("--loud", "--loud (`tactuator --help` lists"),
        ("trial --loud", "--loud (`tactuator trial --help` lists"),
        ("trial --rate-hz fast", "it must be a number (got 'fast')"),
        ("trial surplus", "unexpected surplus; expected options alone (`tactuator trial --help` lists what it takes"),
    ],
)
def test_main__misused__exits_2_with_one_line(arguments, words, trial, run):
    trial(lambda: None)
    run.refused(*arguments.split(), said=words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("measure controller.json", "no measure command 'controller.json'; expected "),
        ("experiment exprt", "no experiment command 'exprt' (did you mean 'export'?)"),
        ("reproduce --seed -1", "it must be at least 0 (got '-1')"),
    ],
)
def test_main__subcommand_or_value_amiss__says_what_is_allowed(arguments, words, run):
    run.refused(*arguments.split(), said=words)


def test_main__interrupted_in_a_verb_that_writes__says_what_was_written(trial, run, tmp_path):
    new, old = tmp_path / "new.csv", tmp_path / "old.csv"
    old.write_text("0")

    def action() -> None:
        new.write_text("1")
        raise KeyboardInterrupt

    trial(action)
    for out, said in ((new, new), (old, "nothing")):
        assert run("trial", "--file", str(out)) == (130, "", f"tactuator: interrupted; written: {said}\n")


VERB = """
import os, signal, sys, time, types, weakref
from importlib import import_module
program = import_module("tactuator.cli.main")
def trial():
    {body}
module = types.ModuleType("tactuator.trial")
module.trial = trial
sys.modules["tactuator.trial"] = module
table = import_module("tactuator.cli.commands")
table.COMMANDS["trial"] = table.Command("trial", "trial:trial", "Try.", "Trials")
sys.argv = ["tactuator", "trial"]
sys.exit(program.main())
"""
CLEANING = """
    try:
        open({path!r}, "w").close()
        print("ready", flush=True)
        time.sleep(60)
    finally:
        os.unlink({path!r})
"""


@pytest.mark.parametrize(
    ("number", "status", "said"), [(signal.SIGINT, 130, b"tactuator: interrupted\n"), (signal.SIGTERM, 143, b"")]
)
def test_main__stopped_by_a_signal__cleans_up_and_says_so(number, status, said, tmp_path):
    half = tmp_path / "half-written"
    script = VERB.replace("{body}", CLEANING.format(path=str(half)).strip())
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"ready\n"
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (status, said)
    assert not half.exists()


def test_program__installed_reader_gone__ends_without_a_word():
    with subprocess.Popen([PROGRAM, "--version"], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        err = process.stderr.read()
    assert err == b""


DISPLAY = EXAMPLES / "displays" / "tactuator.toml"
OURS = "tactuator/cli"
"""What the path of each module holds that is imported once the handler stands."""
INTERRUPTED = (130, "tactuator: interrupted\n")

LOADING = """
import os, signal, sys, weakref
class Held:
    pass
def at_once():
    os.kill(os.getpid(), signal.SIGINT)
def in_a_callback():
    held = Held()
    kept = weakref.ref(held, lambda gone: (os.kill(os.getpid(), signal.SIGINT), sum(range(9))))
    del held
def turned_by_a_library():
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt as error:
        raise OSError("a library's own words") from error
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            {how}()
sys.meta_path.insert(0, Finder())
sys.argv = ["tactuator", "design", "missing.toml", "--out", "c.json"]
exec(open({program!r}).read())
"""
"""The installed program with a Ctrl-C as a module is looked for."""


@pytest.mark.parametrize(
    ("module", "how"),
    [
        ("tactuator.cli", "at_once"),
        ("typing", "in_a_callback"),
        ("typer", "in_a_callback"),
        ("tactuator.cli.command", "at_once"),
        ("tactuator.api.controller", "turned_by_a_library"),
    ],
)
def test_program__ctrl_c_as_a_module_loads__one_line_and_130(module, how):
    script = LOADING.format(module=module, how=how, program=str(PROGRAM))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == INTERRUPTED


def interrupted(folder: Path, after_s: float) -> tuple[int, str]:
    command = [PROGRAM, "design", DISPLAY, "--out", folder / "controller.json"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        time.sleep(after_s)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    return process.returncode, said


def test_answer__long_table__is_printed_in_parts_as_it_would_be_whole(monkeypatch, capsys) -> None:
    class Long(Result):
        def facts(self) -> Sequence[Fact]:
            return []

        def tables(self) -> Sequence[ResultTable | str]:
            rows = tuple((f"S{row}", f":sun: [b]{row}") for row in range(50))
            return [ResultTable("Thresholds", ("subject", "level (dB SL)"), rows, ("a note",)), "a line"]

    answer(Long(), as_json=False, full=True)
    whole = capsys.readouterr().out
    assert whole.splitlines()[-2:] == ["a note", "a line"]
    assert ":sun: [b]49" in whole
    parts = list[int]()
    monkeypatch.setattr(output, "_AT_ONCE", 7)
    monkeypatch.setattr(output, "Segments", lambda part: parts.append(len(part)) or Segments(part))
    answer(Long(), as_json=False, full=True)
    assert capsys.readouterr().out == whole
    assert max(parts) == 7

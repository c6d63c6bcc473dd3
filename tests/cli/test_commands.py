"""Commands out of the verbs' signatures: parsing is light, each is in the reference, and shells complete them."""

import inspect
import json
import os
import subprocess
import sys
from dataclasses import MISSING, fields
from pathlib import Path
from typing import get_args, get_origin, get_type_hints

import pytest
import typer

from tactuator.cli.commands import command_of
from tactuator.cli.main import build_app
from tactuator.entry_points import plugins
from tactuator.experiment.simulated.quality import Setting
from tactuator.identification.asked import Asked
from tactuator.measure.open_loop import CalibrationRequest
from tactuator.rig.open import RIGS
from tactuator.rig.streaming_check import INSTRUCTION_NS
from tactuator.verbs.parameters import RIG_HELP, Fields, constant, sentence_of
from tactuator.verbs.table import FIRST, FUNCTIONS, top_verbs, verb_of
from tools.cli_reference import PAGE, reference, sorted_commands

HEAVY = ("numpy", "scipy", "h5py", "matplotlib", "soundfile", "sqlalchemy", "fastapi", "rich", "pydantic")
COMMANDS = list(sorted_commands(typer.main.get_command(build_app()), ("tactuator",)))
KINDS = {str, int, float, bool, Path, list, type(None)}


def test_verbs__each__has_types_that_the_command_line_knows_and_its_docstrings_sentence() -> None:
    for name, place in FUNCTIONS.items():
        for parameter in inspect.signature(command_of(verb_of(name))).parameters.values():
            kinds = get_args(parameter.annotation) or (parameter.annotation,)
            assert {get_origin(kind) or kind for kind in kinds} <= KINDS, parameter
        assert (inspect.getdoc(verb_of(name)) or "").startswith(sentence_of(place))
        assert len(sentence_of(place)) <= 57, name


def test_commands__each__is_in_the_reference_says_what_it_and_its_parameters_are_and_can_answer_in_json() -> None:
    assert PAGE.read_text(encoding="utf-8") == reference(), "out of date: make docs"
    for path, command in COMMANDS:
        assert (command.help or "").strip(), path
        for parameter in command.params:
            assert (getattr(parameter, "help", None) or "").strip(), (path, parameter.name)
        assert path[-1] in ("serve", "console") or any("--json" in each.opts for each in command.params), path
    kinds = {name for name, point in plugins(RIGS).items() if point.value.startswith("tactuator.")}
    assert {name.partition(":")[0] for name in RIG_HELP.rstrip(".").split(", ")} == kinds


@pytest.mark.parametrize("declared", [Asked, CalibrationRequest, Setting])
def test_fields__read_from_the_source__are_those_of_the_dataclass(declared: type) -> None:
    read = Fields(f"{declared.__module__.removeprefix('tactuator.')}:{declared.__name__}")
    for field in fields(declared):
        if field.default is not MISSING:
            assert read.default(field.name) == field.default
    if declared is Asked:
        hints = get_type_hints(Asked, include_extras=True)
        assert {read.option(name).help for name in hints} == {get_args(hint)[1].description for hint in hints.values()}
        assert constant("rig.streaming_check", "INSTRUCTION_NS") == INSTRUCTION_NS


def test_parsing__help_and_a_missing_file__import_nothing_heavy(tmp_path: Path) -> None:
    asked = [
        ["--help"],
        *([verb, "--help"] for verb in top_verbs()),
        ["experiment", "serve", "--help"],
        ["--version"],
        ["identify", "no.csv"],
    ]
    program = (
        "import json, sys; from tactuator.cli import main; "
        "done = [(main(one), sorted(set(sys.argv[1].split()) & set(sys.modules))) for one in json.loads(sys.argv[2])]; "
        "sys.stderr.write(json.dumps(done))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, " ".join(HEAVY), json.dumps(asked)],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    refusal, said = done.stderr.splitlines()
    assert refusal == "tactuator: records no.csv: No such file or directory; allowed: one that can be read"
    # typer has pydantic look at the words of a verb; its help needs none
    assert json.loads(said) == [[0, []]] * (len(asked) - 1) + [[2, ["pydantic"]]]


def test_scipy__imported_after_our_arrays__leaves_numpys_translator_of_fortran_for_later() -> None:
    program = (
        "import sys, tactuator.arrays, scipy.linalg, numpy; late = 'numpy.f2py.crackfortran' not in sys.modules; "
        "print(late, callable(numpy.f2py.get_include))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True"]


def completed(shell: str, line: str) -> str:
    words = line.split(" ")
    said = {"_TACTUATOR_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_ARGS": line,
            "COMP_WORDS": "\n".join(words), "COMP_CWORD": str(len(words) - 1),
            "_TYPER_COMPLETE_FISH_ACTION": "get-args"}  # fmt: skip
    program = [sys.executable, "-m", "tactuator"]
    return subprocess.run(program, env={**os.environ, **said}, capture_output=True, text=True, check=False).stdout


def test_completion__of_a_verb_a_part_and_an_option__in_every_shell() -> None:
    assert "design" in completed("zsh", "tactuator des")
    assert "thresholds" in completed("fish", "tactuator experiment thr")
    assert "--figures" in completed("bash", "tactuator design --fig")


def test_completion__in_bash_itself__offers_the_verb() -> None:
    script = (
        'eval "$(_TACTUATOR_COMPLETE=source_bash tactuator)"; COMP_WORDS=(tactuator corp); COMP_CWORD=1; '
        '_tactuator_completion tactuator; echo "${COMPREPLY[@]}"'
    )
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    done = subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["corpus"]


def test_help__of_everything__has_the_first_verbs_at_the_top_and_each_in_one_line(run, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    shown = run("--help").out
    verbs = [*FIRST, *(verb for verb in top_verbs() if verb not in FIRST)]
    said = [line.split() for line in shown.splitlines() if line.startswith("  ") and line.split()[0] in verbs]
    assert [words[0] for words in said] == verbs
    assert all(words[-1].endswith(".") for words in said)
    assert "…" not in shown

"""Commands out of the verbs' signatures: parsing is light, and what a verb needs is imported when it is run."""

import inspect
import json
import os
import subprocess
import sys
from dataclasses import MISSING, fields
from pathlib import Path
from typing import get_args, get_origin, get_type_hints

import pytest

from tactuator.cli import main
from tactuator.cli.commands import command_of
from tactuator.experiment.simulated.quality import Setting
from tactuator.identification.asked import Asked
from tactuator.measure.open_loop import CalibrationRequest
from tactuator.rig.streaming_check import INSTRUCTION_NS
from tactuator.verbs.parameters import Fields, constant, sentence_of
from tactuator.verbs.table import FIRST, FUNCTIONS, top_verbs, verb_of
from tests.cli.refusals import refused

HEAVY = ("numpy", "scipy", "h5py", "matplotlib", "soundfile", "sqlalchemy", "fastapi", "rich", "pydantic")


@pytest.mark.parametrize("name", FUNCTIONS)
def test_signature__each_parameter_for_the_command_line__has_a_type_that_it_knows(name: str) -> None:
    command = inspect.signature(command_of(verb_of(name)))
    for parameter in command.parameters.values():
        kinds = get_args(parameter.annotation) or (parameter.annotation,)
        assert {get_origin(kind) or kind for kind in kinds} <= {str, int, float, bool, Path, list, type(None)}, (
            parameter
        )


@pytest.mark.parametrize("name", FUNCTIONS)
def test_sentence__read_from_the_source__is_that_of_the_docstring(name: str) -> None:
    assert (inspect.getdoc(verb_of(name)) or "").startswith(sentence_of(FUNCTIONS[name]))
    assert len(sentence_of(FUNCTIONS[name])) <= 57


@pytest.mark.parametrize("declared", [Asked, CalibrationRequest, Setting])
def test_fields__read_from_the_source__are_those_of_the_dataclass(declared: type) -> None:
    read = Fields(f"{declared.__module__.removeprefix('tactuator.')}:{declared.__name__}")
    for field in fields(declared):
        if field.default is not MISSING:
            assert read.default(field.name) == field.default
    if declared is Asked:
        hints = get_type_hints(Asked, include_extras=True)
        assert {read.option(name).help for name in hints} == {get_args(hint)[1].description for hint in hints.values()}


def test_constant__read_from_the_source__is_it() -> None:
    assert constant("rig.streaming_check", "INSTRUCTION_NS") == INSTRUCTION_NS


def test_written_file__is_told_once_and_a_verb_gives_its_result_as_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["init", "--out", "mine.toml", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"written": ["mine.toml"]}
    assert main(["design", "mine.toml", "--poles", "1"]) == 2
    assert "poles is 1; allowed: a whole number, 2 to 16" in capsys.readouterr().err


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
    refusal, told = done.stderr.splitlines()
    assert refusal == "tactuator: records no.csv: No such file or directory; allowed: one that can be read"
    # typer has pydantic look at the words of a verb; its help needs none
    assert json.loads(told) == [[0, []]] * (len(asked) - 1) + [[2, ["pydantic"]]]


@pytest.mark.parametrize(
    "arguments",
    [["check", "none.json"], ["check", "controller.json", "--display", "none.toml"], ["play", "none.wav"]],
    ids=" ".join,
)
def test_verb__a_file_that_is_not_there__refused_by_name(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "controller.json").write_text("{}")
    refused(arguments, "none.", capsys, tmp_path)


def completed(shell: str, line: str) -> str:
    words = line.split(" ")
    told = {"_TACTUATOR_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_ARGS": line,
            "COMP_WORDS": "\n".join(words), "COMP_CWORD": str(len(words) - 1),
            "_TYPER_COMPLETE_FISH_ACTION": "get-args"}  # fmt: skip
    program = [sys.executable, "-m", "tactuator"]
    return subprocess.run(program, env={**os.environ, **told}, capture_output=True, text=True, check=False).stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion__of_a_verb_a_part_and_an_option__in_every_shell(shell: str) -> None:
    assert "design" in completed(shell, "tactuator des")
    assert "thresholds" in completed(shell, "tactuator experiment thr")
    assert "--figures" in completed(shell, "tactuator design --fig")


def test_completion__in_bash_itself__offers_the_verb(tmp_path: Path) -> None:
    folder = Path(sys.executable).parent
    script = (
        'eval "$(_TACTUATOR_COMPLETE=source_bash tactuator)"; COMP_WORDS=(tactuator corp); COMP_CWORD=1; '
        '_tactuator_completion tactuator; echo "${COMPREPLY[@]}"'
    )
    environment = {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"}
    done = subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["corpus"]


def test_module__run_as_a_program__is_the_command_line() -> None:
    done = subprocess.run([sys.executable, "-m", "tactuator", "desing"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "did you mean 'design'?" in done.stderr


def test_help__of_everything__has_the_first_verbs_at_the_top_and_each_in_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    lines = shown.splitlines()
    verbs = [*FIRST, *(verb for verb in top_verbs() if verb not in FIRST)]
    told = [line.split() for line in lines if line.startswith("  ") and line.split()[0] in verbs]
    assert [words[0] for words in told] == verbs
    assert all(words[-1].endswith(".") for words in told)
    assert "…" not in shown

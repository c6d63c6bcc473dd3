"""Verbs whose work is imported only when they are run: each signature fits its work, and parsing is light."""

import importlib
import inspect
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Annotated, get_args, get_origin, get_type_hints

import pytest

from tactuator.cli import main
from tactuator.cli.deferred import Verb, done_by
from tactuator.cli.model.record import EXCITATIONS
from tactuator.cli.verbs import GROUPS, VERBS
from tactuator.rig.board_check.streaming_check import INSTRUCTION_NS
from tactuator.speech.options import LEVEL_DB_SL
from tests.cli.refusals import refused

HEAVY = ("numpy", "scipy", "h5py", "matplotlib", "soundfile", "sqlalchemy", "fastapi", "rich", "pydantic")
SIGNATURES: dict[str, Verb] = {
    name: verb
    for group in GROUPS
    for name, verb in importlib.import_module(f"tactuator.cli.{group}.verbs").VERBS.items()
}


def plain(hint: object) -> object:
    """Return an annotation without what is said to the command line."""
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


@pytest.mark.parametrize("name", SIGNATURES)
def test_signature__each__has_the_parameters_and_types_of_its_work(name: str) -> None:
    verb = SIGNATURES[name]
    asked = {key: plain(hint) for key, hint in get_type_hints(verb, include_extras=True).items()}
    assert asked == get_type_hints(done_by(verb))
    assert set(vars(verb)["reads"]) <= set(asked)


@pytest.mark.parametrize("name", SIGNATURES)
def test_signature__each_and_its_work__say_the_same(name: str) -> None:
    assert inspect.getdoc(SIGNATURES[name]) == inspect.getdoc(done_by(SIGNATURES[name]))


def test_defaults__that_stand_for_a_constant__are_it() -> None:
    def default(name: str, parameter: str) -> object:
        return inspect.signature(SIGNATURES[name]).parameters[parameter].default

    assert default("render", "level") == default("corpus", "level") == LEVEL_DB_SL
    assert default("firmware stream", "instruction_ns") == INSTRUCTION_NS
    excitation = get_type_hints(SIGNATURES["record"], include_extras=True)["excitation"]
    assert get_args(excitation)[1].help == ", ".join(EXCITATIONS) + "."


def test_parsing__help_and_a_missing_file__import_nothing_heavy(tmp_path: Path) -> None:
    asked = [
        ["--help"],
        *([verb, "--help"] for verb in VERBS),
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


def test_help__of_everything__has_the_groups_in_the_order_of_the_chain(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    places = [shown.index(f"\n  {verb} ") for verb in VERBS]
    assert places == sorted(places)

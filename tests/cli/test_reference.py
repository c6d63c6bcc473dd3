"""Every verb keeps the common spelling and is in the reference."""

import typer

from tactuator.cli.main import build_app
from tactuator.entry_points import plugins
from tactuator.rig.open import RIGS
from tactuator.verbs.parameters import RIG_HELP
from tactuator.verbs.table import top_verbs
from tools.cli_reference import PAGE, reference, sorted_commands

COMMANDS = list(sorted_commands(typer.main.get_command(build_app()), ("tactuator",)))


def test_reference__page__is_current():
    assert PAGE.read_text(encoding="utf-8") == reference(), "out of date: make docs"


def test_verbs__each__registers_itself_under_its_own_name():
    for verb in top_verbs():
        registered = list(typer.main.get_command(build_app([verb])).commands)
        assert registered == [verb], f"cli/{verb} registers {registered}"


def test_commands__each__says_what_it_does():
    silent = [" ".join(path) for path, command in COMMANDS if not (command.help or "").strip()]
    assert silent == []


def test_commands__each_parameter__says_what_it_is():
    silent = [
        (" ".join(path), parameter.name)
        for path, command in COMMANDS
        for parameter in command.params
        if not (getattr(parameter, "help", None) or "").strip()
    ]
    assert silent == []


def test_commands__each_that_ends_by_itself__can_answer_in_json():
    answering = [(path, command) for path, command in COMMANDS if path[-1] not in ("serve", "console")]
    mute = [" ".join(path) for path, command in answering if not any("--json" in p.opts for p in command.params)]
    assert mute == []


def test_help_of_rig__names_every_kind_of_rig() -> None:
    kinds = {name for name, point in plugins(RIGS).items() if point.value.startswith("tactuator.")}
    assert {name.partition(":")[0] for name in RIG_HELP.rstrip(".").split(", ")} == kinds

"""The application: all commands with their sentences; only those that may run are imported."""

from collections.abc import Container
from typing import Annotated

import typer
from typer._click import Context, HelpFormatter
from typer.core import TyperGroup

import tactuator
from tactuator.cli.commands import COMMANDS, FIRST, GROUPS, subcommands, top_commands

ABOUT = "Design and test tactile displays that feel equally strong at every frequency."


class GroupedHelp(TyperGroup):
    """The group of all commands: its help has those that a newcomer needs, then the rest, in groups."""

    def format_commands(self, ctx: Context, formatter: HelpFormatter) -> None:
        """Write a section for each group, each command in one whole line."""
        width = max(map(len, self.commands), default=0)
        sections: dict[str, dict[str, None]] = {"The first commands": dict.fromkeys(FIRST)}
        for command in COMMANDS.values():
            name = command.name.partition(" ")[0]
            if name not in FIRST:
                title = f"More: {command.group[0].lower()}{command.group[1:]}"
                sections.setdefault(title, {})[name] = None
        for title, names in sections.items():
            known = [(name.ljust(width), self.commands[name].help or "") for name in names if name in self.commands]
            if known:
                with formatter.section(title):
                    formatter.write_dl(known)


def build_app(runs: Container[str] = COMMANDS) -> typer.Typer:
    """Return the application. runs: the commands that may be run; of all others it has the sentence alone."""
    app = typer.Typer(
        name="tactuator", cls=GroupedHelp, help=ABOUT, pretty_exceptions_enable=False, rich_markup_mode=None
    )

    @app.callback(invoke_without_command=True)
    def about(
        context: typer.Context,
        version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
    ) -> None:
        if version:
            typer.echo(f"tactuator {tactuator.__version__}")
        elif context.invoked_subcommand is None:
            typer.echo(context.get_help())

    groups = {name: typer.Typer(help=sentence, rich_markup_mode=None) for name, sentence in GROUPS.items()}
    for name in top_commands():
        if name in groups:
            app.add_typer(groups[name], name=name)
        for full in [f"{name} {each}" for each in subcommands(name)] or [name]:
            home, command = groups.get(name, app), COMMANDS[full]
            run = command.load() if full in runs else lambda: None
            home.command(full.rpartition(" ")[2], help=None if full in runs else command.sentence)(run)
    return app

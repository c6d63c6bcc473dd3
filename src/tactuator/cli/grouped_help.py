"""The help of the whole program: verbs in groups, in the order of the chain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from typer.core import TyperGroup

from tactuator.cli.verbs import GROUPS, TITLES

if TYPE_CHECKING:
    from typer._click import Context, HelpFormatter, Parameter


class QuickGroup(TyperGroup):
    """A group whose switches are off, not unknown, where they are not given.

    Typer imports pydantic to look at a value that is unknown, which takes as long as a verb's whole help.
    """

    def get_params(self, ctx: Context) -> list[Parameter]:
        """Return the group's options, `--help` among them."""
        there: list[Parameter] = super().get_params(ctx)
        for one in there:
            if getattr(one, "is_flag", False) and one.default is None:
                one.default = False
        return there


class GroupedHelp(QuickGroup):
    """The group of all verbs, whose help has a section for each room."""

    def format_commands(self, ctx: Context, formatter: HelpFormatter) -> None:
        """Write a section for every group of verbs that are there."""
        there = {name: self.commands[name] for name in self.list_commands(ctx)}
        width = max((len(name) for name in there), default=0)
        for group, verbs in GROUPS.items():
            known = [(verb.ljust(width), there[verb].get_short_help_str(80)) for verb in verbs if verb in there]
            if known:
                with formatter.section(TITLES[group]):
                    formatter.write_dl(known)

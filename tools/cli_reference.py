"""Write `docs/cli.md` from the commands themselves: `make docs`. A test tells when it is out of date."""

import inspect
from collections import Counter
from pathlib import Path

import typer

from tactuator.cli.main import build_app

SHARED = 3
"""An option that so many commands spell alike stands in the first table."""
PAGE = Path(__file__).resolve().parent.parent / "docs" / "cli.md"
HEAD = """# The commands

Written by `make docs` from the commands themselves: each argument and option, what it says, and its default.

- `--json` prints exactly one JSON object on standard output. Progress goes to standard error, and only to a
  terminal. Numbers that JSON cannot say (infinite, not a number) are `null`.
- Exit status 0: done. 1: done, and the verdict is no. 2: bad input, told in one line on standard error. 3: a
  device failed, or its port cannot be opened. 130: interrupted. 70: a fault of tactuator's own, with its traceback.
- Output is written beside its final name and renamed when whole.
"""


def reference():
    """Return the page's text: options that several verbs share stand once."""
    commands = list(sorted_commands(typer.main.get_command(build_app()), ("tactuator",)))
    tables = {path: rows_of(path, command) for path, command in commands}
    count = Counter(row for rows in tables.values() for row in rows)
    shared = [row for row in count if count[row] >= SHARED]
    table = ["## Options of several verbs", "", *shared, ""]
    parts = [HEAD, "\n".join(table)]
    return "\n".join([*parts, *(section(path, command, tables[path], shared) for path, command in commands)])


def sorted_commands(command, path):
    """Yield (path, command) for every command that can be run, in the order of registration, groups opened."""
    for name, child in getattr(command, "commands", {}).items():
        if getattr(child, "commands", None):
            yield from sorted_commands(child, (*path, name))
        else:
            yield (*path, name), child


def rows_of(path, command):
    """Return a line for each argument and option of a command."""
    context = typer.Context(command, info_name=" ".join(path))
    return [row(parameter, context) for parameter in command.params if not getattr(parameter, "hidden", False)]


def section(path, command, rows, shared):
    """Return one command's section: what it does, its arguments and options, and the names of the shared ones."""
    text = " ".join(inspect.cleandoc(command.help or "").replace("\f", "").split())
    names = [each.split("`")[1].split()[0] for each in rows if each in shared]
    also = f" Also: {', '.join(f'`{name}`' for name in names)}." if names else ""
    special = [each for each in rows if each not in shared]
    return "\n".join(["## " + " ".join(path), "", text + also, "", *special, *([""] if special else [])])


def row(parameter, context):
    """Return one line: names, meaning, default."""
    argument = parameter.param_type_name == "argument"
    names = parameter.display_name_raw if argument else ", ".join([*parameter.opts, *parameter.secondary_opts])
    kind = "" if getattr(parameter, "is_flag", False) else " " + parameter.display_type(context)
    shown = f"`{names}`" if argument else f"`{names}{kind}`"
    meaning = " ".join((getattr(parameter, "help", None) or "").split())
    default = default_of(parameter)
    return f"- {shown}: {meaning}" + (f" ({default})" if default else "")


def default_of(parameter):
    """Return the default as a person would write it."""
    if parameter.required:
        return "required"
    value = parameter.default
    if value is None or value is False or callable(value) or value == ():
        return ""
    return f"`{getattr(value, 'value', value)}`"


if __name__ == "__main__":
    part = PAGE.with_suffix(".part")
    part.write_text(reference(), encoding="utf-8")
    part.rename(PAGE)

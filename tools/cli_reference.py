"""Write `docs/cli.md` from the commands themselves: `make docs`. A test tells when it is out of date."""

import inspect
from pathlib import Path

import typer

from tactuator.cli.main import build_app

PAGE = Path(__file__).resolve().parent.parent / "docs" / "cli.md"
HEAD = """# The commands

Written by `make docs` from the commands themselves; a test keeps it current.

Every verb keeps the same promises:

- `--json` prints exactly one JSON object on standard output and nothing else. Progress goes to standard error, and
  only to a terminal. Numbers that JSON cannot say (infinite, not a number) are `null`.
- Exit status 0: done. 1: done, and the verdict is no. 2: bad input, told in one line on standard error that names
  what was got and what is allowed. 3: a device failed, or its port cannot be opened. 130: interrupted, told in one
  line (a Ctrl-C in the first hundredths of a second, while Python itself starts, ends as Python ends it). 70: a
  fault of tactuator's own, with its traceback.
- Output is written beside its final name and renamed when whole: no half-written file under a final name.

`tactuator --version` tells the version.
"""


def reference():
    """Return the page's text."""
    root = typer.main.get_command(build_app())
    parts = [HEAD]
    for path, command in sorted_commands(root, ("tactuator",)):
        parts.append(section(path, command))
    return "\n".join(parts)


def sorted_commands(command, path):
    """Yield (path, command) for every command that can be run, in the order of registration, groups opened."""
    for name, child in getattr(command, "commands", {}).items():
        if getattr(child, "commands", None):
            yield from sorted_commands(child, (*path, name))
        else:
            yield (*path, name), child


def section(path, command):
    """Return one command's section: usage, what it does, its arguments and options."""
    context = typer.Context(command, info_name=" ".join(path))
    usage = " ".join([*path, *(piece for piece in command.collect_usage_pieces(context))])
    parameters = [row(parameter, context) for parameter in command.params if not getattr(parameter, "hidden", False)]
    text = inspect.cleandoc(command.help or "").replace("\f", "")
    lines = ["## " + " ".join(path), "", "```text", usage, "```", "", text, ""]
    if parameters:
        lines += ["| | | default |", "|---|---|---|", *parameters, ""]
    return "\n".join(lines)


def row(parameter, context):
    """Return one table row: names, meaning, default."""
    argument = parameter.param_type_name == "argument"
    names = parameter.display_name_raw if argument else ", ".join([*parameter.opts, *parameter.secondary_opts])
    kind = "" if getattr(parameter, "is_flag", False) else " " + parameter.display_type(context)
    shown = f"`{names}`" if argument else f"`{names}{kind}`"
    meaning = " ".join((getattr(parameter, "help", None) or "").split())
    return "| {} | {} | {} |".format(*(cell.replace("|", "\\|") for cell in (shown, meaning, default_of(parameter))))


def default_of(parameter):
    """Return the default as a person would write it."""
    if parameter.required:
        return "(must be given)"
    value = parameter.default
    if value is None or value is False or callable(value) or value == ():
        return ""
    return f"`{getattr(value, 'value', value)}`"


if __name__ == "__main__":
    part = PAGE.with_suffix(".part")
    part.write_text(reference(), encoding="utf-8")
    part.rename(PAGE)

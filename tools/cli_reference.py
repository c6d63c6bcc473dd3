"""Write `docs/cli.md` from the commands themselves: `make docs`. A test tells when it is out of date."""

import inspect
from collections import Counter
from pathlib import Path

import typer

from tactuator.cli.main import build_app

PAGE = Path(__file__).resolve().parent.parent / "docs" / "cli.md"
HEAD = """# The commands

Written by `make docs` from the commands themselves. An argument is required unless it is said to be optional, an
option only where it says so. A default stands in brackets and shows the type of the value; `…` is text or a path.

- `--json`, of every command that ends by itself: one JSON object on standard output, nothing else; numbers that JSON
  cannot say are `null`. Progress goes to standard error, if that is a terminal.
- Exit status 0: done. 1: done, and the verdict is no. 2: bad input, told in one line. 3: a device failed.
  130: interrupted. 70: a fault of tactuator's own, with its traceback.
- Output is written beside its final name and renamed when whole.
"""


def reference():
    """Return the page's text: options that several verbs share stand once."""
    commands = list(sorted_commands(typer.main.get_command(build_app()), ("tactuator",)))
    tables = {path: rows_of(path, command) for path, command in commands}
    shared = shared_rows([row for rows in tables.values() for row in rows])
    table = ["## Options of several verbs", "", *shared, ""]
    parts = [HEAD, "\n".join(table)]
    return "\n".join([*parts, *(section(path, command, tables[path], shared) for path, command in commands)])


def shared_rows(rows):
    """Return the rows of three commands or more, and those of two whose name means nothing else elsewhere."""
    count, names = Counter(rows), Counter(name_of(row) for row in rows)
    return [row for row in count if count[row] > 2 or count[row] == 2 == names[name_of(row)]]


def name_of(row):
    """Return the name of a row's argument or option."""
    return row.split("`")[1].split()[0]


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
    return [row(parameter, context) for parameter in command.params if shown(parameter)]


def shown(parameter):
    """Tell whether a parameter has a line: not where it is hidden, nor `--json`, which the head tells of."""
    return not getattr(parameter, "hidden", False) and "--json" not in parameter.opts


def section(path, command, rows, shared):
    """Return one command's section: what it does, its arguments and options, and the names of the shared ones."""
    text = " ".join(inspect.cleandoc(command.help or "").replace("\f", "").split()).split(" Raises ")[0]
    names = [name_of(each) for each in rows if each in shared]
    also = f" Also: {', '.join(f'`{name}`' for name in names)}." if names else ""
    special = [each for each in rows if each not in shared]
    return "\n".join(["## " + " ".join(path[1:]), "", text + also, "", *special, *([""] if special else [])])


def row(parameter, context):
    """Return one line: names, meaning, default."""
    argument = parameter.param_type_name == "argument"
    names = parameter.display_name_raw if argument else ", ".join([*parameter.opts, *parameter.secondary_opts])
    meaning = " ".join((getattr(parameter, "help", None) or "").split())
    default = default_of(parameter)
    kind = plain_type(parameter.display_type(context))
    if argument:
        default = "" if parameter.required else "optional"
    elif not getattr(parameter, "is_flag", False) and not default.startswith("`"):  # a default shows its type
        names += " …" if kind.lower() in ("<str>", "<path>") else " " + kind
    return f"- `{names}`: {meaning}" + (f" ({default})" if default else "")


def plain_type(text):
    """Return the type of an option's value without its bounds and its list."""
    return text.replace(" range", "").replace("list[", "").replace("]", "")


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

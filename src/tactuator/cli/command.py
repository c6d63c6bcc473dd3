"""A command made of a function: the only place that knows how a parameter is spelled on the command line."""

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args, get_origin

import typer

from tactuator.api.option import AS_IN_PYTHON, Argument, Option, option_in
from tactuator.api.progress import watched
from tactuator.cli.output import Bars, answer
from tactuator.errors import BadInput, Interrupted, TactuatorError, reason_of
from tactuator.io.atomic import check_folder, check_parent
from tactuator.io.kinds import KINDS, require_kind, require_replaceable
from tactuator.io.text import parse_toml, read_text

DOES_NOT_HOLD = 1
"""Exit status of a command whose result does not hold: a requirement is not met, a model not trusted."""
_STATUS = ((". `holds` is False", ". Exit status 1"), ("`holds` is False", "exit status 1"))
"""What a docstring says of a result that does not hold, and what the help says."""

_ANSWERS = {
    "as_json": Option("Print exactly one JSON object on standard output.", ("--json",)),
    "full": Option("Print the tables, not the summary alone.", ("--full",)),
}
"""Options of every command that ends by itself."""


def command_of(function: Callable[..., Any]) -> Callable[..., None]:
    """Return the command of a function: it looks for the files that are read, calls it and prints its result.

    A function that returns nothing is at work until it is interrupted, and has neither `--json` nor `--full`.
    """
    signature = inspect.signature(function)
    options = {name: option_in(parameter.annotation) for name, parameter in signature.parameters.items()}
    known = {name: option for name, option in options.items() if option is not None}
    typed = _speller(known)

    @_as_typed(known, typed)
    def command(**given: Any) -> None:
        as_json, full = given.pop("as_json", False), given.pop("full", False)
        for name, option in known.items():
            if option.file:
                _look_for(name, given[name])
        _keep_what_is_there(known, given)
        places = [given[name] for name, option in known.items() if option.writes and given[name] is not None]
        before = {place: _changed_ns(place) for place in places}
        try:
            with watched(Bars()):
                result = function(**given)
            if result is None:
                return
            written = [place for place in places if place.exists() and result.ending is None]
            answer(result, as_json, full, written, typed)
        except KeyboardInterrupt as error:
            changed = [str(place) for place in places if _changed_ns(place) != before[place]]
            changed += getattr(error, "__notes__", ())
            if not (places or changed):
                raise
            raise Interrupted(f"interrupted; written: {', '.join(changed) or 'nothing'}") from None
        if result.ending is not None:
            raise result.ending
        if not result.holds:
            raise typer.Exit(DOES_NOT_HOLD)

    parameters = [_typer_parameter(signature.parameters[name], option, name) for name, option in known.items()]
    if signature.return_annotation is not None:
        parameters += [_typer_parameter(_SWITCH, option, name) for name, option in _ANSWERS.items()]
    command.__name__ = function.__name__
    about = " ".join((inspect.getdoc(function) or "").partition("\n\n")[0].split())
    for in_python, in_the_shell in _STATUS:
        about = about.replace(in_python, in_the_shell)
    command.__doc__ = typed(about)
    vars(command)["__signature__"] = inspect.Signature(parameters)
    return command


_SWITCH = inspect.Parameter("switch", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=bool)


def _typer_parameter(parameter: inspect.Parameter, option: Option, name: str) -> inspect.Parameter:
    default = parameter.default if option.shell is AS_IN_PYTHON else option.shell
    required = default is inspect.Parameter.empty or default is ...
    annotation = get_args(parameter.annotation)[0] if get_origin(parameter.annotation) else parameter.annotation
    path = Path if required or default is not None else Path | None
    kind = option.type or (path if option.file or option.writes else annotation)
    more: dict[str, Any] = {"help": option.help, "metavar": option.metavar}
    if not isinstance(option, Argument) and any(get_origin(each) is list for each in (kind, *get_args(kind))):
        more["help"] += " Repeatable."
    if option.ge is not None or option.le is not None:
        more |= {"min": option.ge, "max": option.le}
    if isinstance(option, Argument):
        spelled: Any = typer.Argument(... if required else default, **more)
    else:
        spelled = typer.Option(... if required else default, *_spellings(name, option), **more)
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=spelled, annotation=kind)


def _spellings(name: str, option: Option) -> tuple[str, ...]:
    return option.names or (f"--{name.replace('_', '-')}",)


def _speller(known: Mapping[str, Option]) -> Callable[[str], str]:
    """Return what spells the parameters that a text names (`name`) as they are typed."""
    typed = {
        name: name if isinstance(option, Argument) else _spellings(name, option)[-1].partition("/")[0]
        for name, option in known.items()
    }
    return lambda text: re.sub(r"`(\w+)`", lambda found: typed.get(found[1], found[0]), text)


@contextmanager
def _as_typed(known: Mapping[str, Option], typed: Callable[[str], str]) -> Iterator[None]:
    """Spell the parameters that an error names as they are typed."""
    try:
        yield
    except TactuatorError as error:
        error.got, error.allowed = typed(error.got), typed(error.allowed)
        if error.key in known and not error.where:  # otherwise it is the key of a file
            error.key = typed(f"`{error.key}`")
        error.__notes__ = [typed(note) for note in getattr(error, "__notes__", ())]
        raise


def _keep_what_is_there(known: Mapping[str, Option], given: Mapping[str, Any]) -> None:
    """Raise BadInput where what is written would replace what is read (an argument, or what a TOML file names) or a
    file of another kind, and where it has no place; first for an argument that is not of the kind it is read as.
    """
    inputs = [
        (name, given_path, path)
        for name, option in known.items()
        if option.file or not option.writes
        for given_path in _paths(given[name])
        for path in (given_path, *_named_in(given_path))
    ]
    for name, option in known.items():
        for place in _paths(given[name]) if option.writes and not option.file else ():
            for read, argument, path in inputs:
                if place.is_file() and _is_same(place, path):
                    if read in KINDS:
                        require_kind(argument, read)
                    raise BadInput(f"`{name}` {place} is a file that the command reads", "another name")
            if option.writes in KINDS:
                require_replaceable(place, option.writes)
            if option.writes == "folder":
                check_folder(place)
            elif place.suffix:  # others may be folders, too
                check_parent(place)


def _changed_ns(place: Path) -> int:
    return place.stat().st_mtime_ns if place.exists() else 0


def _is_same(place: Path, path: Path) -> bool:
    try:
        return place.samefile(path)
    except (OSError, ValueError):  # no file can have such a name, or none has
        return False


def _named_in(path: Path) -> tuple[Path, ...]:
    """Return what the texts of a TOML file name from its folder, but for what is `measured` anew."""
    try:
        document = parse_toml(read_text(path)) if path.suffix == ".toml" else {}
    except BadInput:  # it is refused where it is read
        return ()
    return tuple(path.parent / text for text in _texts_of(document))


def _texts_of(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    values = value.items() if isinstance(value, dict) else enumerate(value if isinstance(value, list) else ())
    for key, each in values:
        yield from _texts_of(each) if key != "measured" else ()


def _paths(value: Any) -> tuple[Path, ...]:
    """Return the paths that a value may be: none of what is no text."""
    values = value if isinstance(value, list | tuple) else (value,)
    return tuple(Path(each) for each in values if isinstance(each, str | Path))


def _look_for(name: str, paths: Path | Sequence[Path] | None) -> None:
    for path in _paths(paths):
        try:
            path.stat()
        except OSError as error:
            raise BadInput(f"{name} {path}: {reason_of(error)}") from None

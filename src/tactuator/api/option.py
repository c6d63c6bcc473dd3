"""What a function's annotation says of a parameter beyond its type: its sentence, its bounds, and whether it is a file.

    poles: Annotated[int | None, Option("Poles of the prefilters.", ge=2, le=16)] = None

A parameter without such a mark is for Python alone. The default is that of the signature; `shell` is the command line's
where it differs (a file is written by default, say).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from annotated_types import Ge, GroupedMetadata, Le

AS_IN_PYTHON: Any = object()
"""The default of the command line is that of the signature."""


@dataclass(frozen=True)
class Option(GroupedMetadata):
    """An option of the command line; pydantic reads its bounds.

    Parameters
    ----------
    help: its sentence.
    names: its spellings; by default the parameter's name.
    ge, le: bounds, included.
    metavar: what the help shows in place of a value.
    file: whether it is a file or folder that must exist.
    writes: kind of the file that is written there, of `KINDS`, or folder.
    type: the command line's type, where a Python caller may give others as well.
    shell: the command line's default.
    """

    help: str
    names: tuple[str, ...] = ()
    ge: float | None = None
    le: float | None = None
    metavar: str | None = None
    file: bool = False
    writes: str = ""
    type: Any = None
    shell: Any = AS_IN_PYTHON

    def __iter__(self) -> Iterator[Ge | Le]:
        """Yield the bounds as pydantic knows them."""
        if self.ge is not None:
            yield Ge(self.ge)
        if self.le is not None:
            yield Le(self.le)


@dataclass(frozen=True)
class Argument(Option):
    """An argument of the command line: it is known by its place."""


def option_of(owner: type, field: str, *names: str, **more: Any) -> Option:
    """Return the option that a field of a dataclass is, with the field's sentence; names, more: as for `Option`."""
    marks = get_args(get_type_hints(owner, include_extras=True)[field])[1:]
    return Option(next(mark.description for mark in marks if getattr(mark, "description", None)), names, **more)


def option_in(annotation: Any) -> Option | None:
    """Return the option in an annotation, None for a parameter that is for Python alone."""
    marks = get_args(annotation)[1:] if get_origin(annotation) is Annotated else ()
    return next((mark for mark in marks if isinstance(mark, Option)), None)

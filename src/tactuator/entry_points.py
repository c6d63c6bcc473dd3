"""Doors to what other packages add: entry points of installed packages, by group and name.

The project's own rigs, procedures and codings are declared in pyproject.toml like anybody's, and found the same way.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from tactuator.errors import BadInput, unknown


@cache
def plugins(group: str) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group (`tactuator.procedures`, say) by name, sorted; they are looked up once.

    Raises BadInput where two packages give different things one name.
    """
    points: dict[str, EntryPoint] = {}
    for point in sorted(entry_points(group=group), key=lambda point: point.name):
        known = points.setdefault(point.name, point)
        if known.value != point.value:
            packages = " and ".join(f"{_package(each)} ({each.value})" for each in (known, point))
            raise BadInput(f"{point.name!r} is declared by {packages}", "each name once", where=(f"plugins {group}",))
    return points


def plugin(group: str, name: str) -> Any:
    """Return what the entry point of that name refers to.

    Raises BadInput, naming those that there are, for a name that nobody declares; and, naming the package, for one that
    cannot be loaded.
    """
    points = plugins(group)
    if name not in points:
        raise unknown("plug-in", name, [*points] or [f"none: no package declares {group}"], where=(group,))
    point = points[name]
    try:
        return point.load()
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise BadInput(
            f"{name!r} of {_package(point)} ({point.value}) cannot be loaded: {' '.join(reason.split())}",
            "a package that can be imported",
            where=(group,),
        ) from error


def _package(point: EntryPoint) -> str:
    return "an unknown package" if point.dist is None else f"{point.dist.name} {point.dist.version}"

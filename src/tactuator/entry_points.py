"""Doors to what other packages add: entry points of installed packages, by group and name.

The project's own rigs, procedures and codings are declared in pyproject.toml like anybody's, and found the same way.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from traceback import walk_tb
from typing import Any

from tactuator.errors import BadInput, TactuatorError, unknown

_LOG = logging.getLogger(__name__)


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


class PluginFault(TactuatorError):
    """A defect of a plug-in, of which `where` says the file, line and function."""

    exit_status = 70


def plugin_fault(error: BaseException) -> PluginFault | None:
    """Return an error as that of the plug-in in whose code it arose, None where it arose in no plug-in's; it is logged
    with its traceback.
    """
    frames = [(frame.f_globals.get("__name__", ""), frame, line) for frame, line in walk_tb(error.__traceback__)]
    groups = [group for group in entry_points().groups if group.startswith("tactuator.")]
    every = [point for group in groups for point in entry_points(group=group)]
    foreign = {point.module.partition(".")[0]: point for point in every if not point.module.startswith("tactuator.")}
    for module, frame, line in reversed(frames):
        point = foreign.get(module.partition(".")[0])
        if point is not None:
            _LOG.info("a plug-in failed", exc_info=error)
            code = frame.f_code
            place = (f"{point.group} {point.name!r} of {_package(point)}", f"{code.co_filename}, line {line}")
            return PluginFault(f"{type(error).__name__} in {code.co_qualname}: {error}", where=place)
    return None


def fault_of(error: BaseException) -> str:
    """Return a defect in one sentence: which plug-in's it is and where, or its kind."""
    return str(plugin_fault(error) or f"{type(error).__name__}: {error}")


def _package(point: EntryPoint) -> str:
    return "an unknown package" if point.dist is None else f"{point.dist.name} {point.dist.version}"

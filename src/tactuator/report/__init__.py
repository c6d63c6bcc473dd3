"""Figures and pages from results: the only floor that draws.

`from tactuator import report` imports a module when it is first used: matplotlib takes a second.
"""

from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    """Import the module of that name."""
    if name.startswith("_"):
        raise AttributeError(name)
    return import_module(f"{__name__}.{name}")

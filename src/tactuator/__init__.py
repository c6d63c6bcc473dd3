"""Tactile displays on which equal reference amplitude is felt equally strongly at every frequency."""

from typing import Any


def __getattr__(name: str) -> Any:
    """Return what is asked for by name, imported when it is asked for."""
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415 (it takes 45 ms, and few ask)

        return version("tactuator")
    raise AttributeError(f"module 'tactuator' has no attribute {name!r}")

"""Files in a workshop's drawer, as if the page had dropped them there."""

from __future__ import annotations

from pathlib import Path

from tactuator.console.workshop import Workshop


def dropped(workshop: Workshop, path: Path, name: str | None = None) -> str:
    """Keep a copy of a file and return its key."""
    key, place = workshop.drawer.place()
    (place / (name or path.name)).write_bytes(path.read_bytes())
    workshop.drawer.keep(key, place / (name or path.name))
    return key

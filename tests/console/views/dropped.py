"""Files in a workshop's drawer, as the page drops them there."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

from tactuator.console.workshop import Workshop


def dropped(workshop: Workshop, path: Path, name: str | None = None) -> str:
    """Drop a file and return its key."""

    async def blocks() -> AsyncIterator[bytes]:
        yield path.read_bytes()

    return asyncio.run(workshop.drawer.take(name or path.name, blocks()))

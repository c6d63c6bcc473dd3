"""Which of a session's open pages counts."""

from __future__ import annotations

from typing import Protocol


class Tab(Protocol):
    """An open page of a session."""

    @property
    def session(self) -> int:
        """Its row in the store."""
        ...

    async def leave(self) -> None:
        """Another page of the session took over."""
        ...


class Tabs:
    """The one tab of every session that counts: the newest."""

    def __init__(self) -> None:
        self._open: dict[int, Tab] = {}

    async def enter(self, tab: Tab) -> None:
        """A tab opens; the one before it is told and closed."""
        before = self._open.get(tab.session)
        self._open[tab.session] = tab
        if before is not None:
            await before.leave()

    def exit(self, tab: Tab) -> None:
        """A tab closes."""
        if self._open.get(tab.session) is tab:
            del self._open[tab.session]

    def is_open(self, session: int) -> bool:
        """Whether the subject's page is connected."""
        return session in self._open

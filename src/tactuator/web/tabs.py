"""The open pages of sessions, of which the newest of each counts."""

from __future__ import annotations

from typing import Protocol


class Tab(Protocol):
    """An open page of a session."""

    @property
    def session(self) -> int:
        """Return the session's row in the store."""
        ...

    async def leave(self) -> None:
        """Tell the page that another page of the session took over."""
        ...


class Tabs:
    """The newest open tab of every session."""

    def __init__(self) -> None:
        self._open: dict[int, Tab] = {}

    async def enter(self, tab: Tab) -> None:
        """Add a tab; the one before it is told and closed."""
        before = self._open.get(tab.session)
        self._open[tab.session] = tab
        if before is not None:
            await before.leave()

    def exit(self, tab: Tab) -> None:
        """Remove a tab that has closed."""
        if self._open.get(tab.session) is tab:
            del self._open[tab.session]

    def is_open(self, session: int) -> bool:
        """Return whether the subject's page is connected."""
        return session in self._open

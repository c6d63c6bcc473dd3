"""Control of a rig: one page has it, the others watch."""

from __future__ import annotations

from typing import Protocol

from tactuator.errors import BadInput


class Page(Protocol):
    """A page that may have the controls."""

    def tell_standing(self) -> None:
        """Tell the page where things stand."""
        ...

    def tell_refusal(self, text: str) -> None:
        """Tell the page what the rig refused."""
        ...


class Controls:
    """The pages of one rig, of which at most one has the controls. The first one gets them."""

    def __init__(self) -> None:
        self._pages: list[Page] = []
        self.holder: Page | None = None

    def enter(self, page: Page) -> None:
        """Add a page; it gets the controls where it is alone."""
        self._pages.append(page)
        if len(self._pages) == 1:
            self.holder = page
        self.tell_all()

    def leave(self, page: Page) -> bool:
        """Remove a page, and return whether it had the controls, which are free then."""
        self._pages.remove(page)
        had = self.holder is page
        if had:
            self.holder = None
        self.tell_all()
        return had

    def take(self, page: Page) -> None:
        """Give a page the controls, whoever had them."""
        self.holder = page
        self.tell_all()

    def give(self, page: Page) -> None:
        """Let the controls go, where the page has them."""
        if self.holder is page:
            self.holder = None
        self.tell_all()

    def require(self, page: Page) -> None:
        """Raise BadInput where the page watches."""
        if self.holder is not page:
            raise BadInput("this page watches; allowed: take over the controls first")

    def tell_all(self) -> None:
        """Tell every page where things stand."""
        for page in self._pages:
            page.tell_standing()

    def tell_refusal(self, text: str) -> None:
        """Tell whoever has the controls what the rig refused."""
        if self.holder is not None:
            self.holder.tell_refusal(text)

"""Control of a rig: one page has it, or an experiment; the others watch."""

from __future__ import annotations

from collections.abc import Callable
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
        self.reserved: Callable[[], None] | None = None

    def reserve(self, stop: Callable[[], None]) -> None:
        """Give the rig to an experiment until `free`; stop: ends what it plays, whoever asks. Raises BadInput where a
        page has the controls, or another experiment.
        """
        if self.reserved is not None:
            raise BadInput("an experiment has the rig", "end that one first")
        if self.holder is not None:
            raise BadInput("another page has the controls of the rig", "take them over, and begin then")
        self.reserved = stop
        self.tell_all()

    def free(self) -> None:
        """End the experiment's hold on the rig; the controls are then for whoever takes them."""
        self.reserved = None
        self.tell_all()

    def enter(self, page: Page) -> None:
        """Add a page; it gets the controls where it is alone and no experiment has the rig."""
        self._pages.append(page)
        if len(self._pages) == 1 and self.reserved is None:
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
        """Give a page the controls, whichever page had them. Raises BadInput where an experiment has the rig."""
        self._require_no_experiment()
        self.holder = page
        self.tell_all()

    def give(self, page: Page) -> None:
        """Let the controls go, where the page has them."""
        if self.holder is page:
            self.holder = None
        self.tell_all()

    def require(self, page: Page) -> None:
        """Raise BadInput where the page watches, or an experiment has the rig."""
        self._require_no_experiment()
        if self.holder is not page:
            raise BadInput("this page watches", "take over the controls first")

    def _require_no_experiment(self) -> None:
        if self.reserved is not None:
            raise BadInput("an experiment has the rig", "watching, stopping it, or ending it in its view")

    def tell_all(self) -> None:
        """Tell every page where things stand."""
        for page in self._pages:
            page.tell_standing()

    def tell_refusal(self, text: str) -> None:
        """Tell whoever has the controls what the rig refused."""
        if self.holder is not None:
            self.holder.tell_refusal(text)

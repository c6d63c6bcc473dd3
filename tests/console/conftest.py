"""The browser of the other pages' tests, for the console's."""

from tests.web.conftest import browser

__all__ = ["browser"]

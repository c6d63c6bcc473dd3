"""Tactile displays on which equal reference amplitude is felt equally strongly at every frequency."""

from importlib.metadata import version

__version__ = version("tactuator")

"""The verb `experiment` and its parts."""

from tactuator.cli.experiment.verbs import register

__all__ = ["register"]

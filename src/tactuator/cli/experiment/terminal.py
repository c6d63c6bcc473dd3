"""A subject at a terminal, who types keys."""

from __future__ import annotations

import typer
from rich.console import Console

from tactuator.experiment.language.words import Words
from tactuator.experiment.session.presented_session import Respondent
from tactuator.experiment.session.session import Acknowledged, NextTrial
from tactuator.experiment.session.task import Question
from tactuator.experiment.trial.trial import Trial


class Terminal(Respondent):
    """A person who types keys."""

    def __init__(self, question: Question, words: Words) -> None:
        self._question, self._words = question, words
        self._keys = {key: choice.response for choice in question.choices for key in choice.keys}
        self._console = Console(stderr=True, markup=False)

    def agree(self, consent: str) -> bool:
        """Ask whether the subject consents."""
        return typer.confirm(f"{consent}\n{self._words('terminal.agree')}", err=True)

    def pause(self) -> None:
        """Wait in a break until Enter."""
        typer.prompt(self._words("terminal.break"), default="", show_default=False, err=True)

    def begin(self, following: NextTrial) -> None:
        """Tell what run comes next."""
        self._console.print(following.planned.introduction)

    def respond(self, trial: Trial) -> str:
        """Ask until a key is one of those that count."""
        offered = ", ".join(f"{choice.keys[0]} = {choice.response}" for choice in self._question.choices)
        while True:
            typed = str(typer.prompt(f"{self._question.prompt} {offered}", prompt_suffix=" > ", err=True)).strip()
            if typed in self._keys:
                return self._keys[typed]
            self._console.print(self._words("terminal.no_key", key=repr(typed)))

    def learn(self, trial: Trial, told: Acknowledged) -> None:
        """Tell which response was right."""
        right = self._words("terminal.right") if told.correct else self._words("terminal.wrong", right=told.right)
        self._console.print(right)

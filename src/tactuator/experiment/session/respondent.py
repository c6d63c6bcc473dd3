"""Takes a subject who is not at a browser through a session: a person at a terminal, a script, a simulated one."""

from __future__ import annotations

import time
from collections.abc import Callable

from tactuator.experiment.session.presented_session import Conduct
from tactuator.experiment.session.session import Session
from tactuator.experiment.session.standing import Acknowledged, NextTrial
from tactuator.experiment.store.records import Answer, Played
from tactuator.experiment.trial.trial import Trial


class Respondent:
    """Who answers. Nothing but the answer has to be said: the rest agrees, goes on and learns nothing."""

    def agree(self, consent: str) -> bool:
        """Whether the subject consents to what the study says."""
        return True

    def pause(self) -> None:
        """A break; returns when the subject goes on."""

    def begin(self, following: NextTrial) -> None:
        """A run begins, or goes on, with that trial."""

    def watch(self, interval: int, begins: bool) -> None:
        """An interval begins, or ends."""

    def presented(self, played: Played) -> None:
        """The trial was played like that."""

    def respond(self, trial: Trial) -> str:
        """One of trial.responses, after its intervals were played."""
        raise NotImplementedError

    def learn(self, trial: Trial, told: Acknowledged) -> None:
        """Told after the answer, in runs with feedback."""


def attend(
    conduct: Conduct,
    respondent: Respondent,
    told: Callable[[Session], None] = lambda session: None,
    rest: Callable[[float], None] = time.sleep,
) -> int:
    """Go through what is left of the session; how many trials were answered. However it ends, the rig is at rest.

    It ends at once where the subject does not consent. told: called after every answer; rest: waits so many seconds
    where a break is not over yet.
    """
    session, run, answered = conduct.session, -1, 0
    try:
        while (stage := session.stage) != "done":
            if stage == "ended":
                break
            if stage == "consent":
                if not respondent.agree(session.task.protocol.study.consent):
                    session.decline()
                    break
                session.give_consent()
            elif stage == "break":
                respondent.pause()
                rest(session.break_left_s)
                session.end_break()
            elif stage == "introduction":
                session.introduce()  # `begin` tells it
            else:
                run = _trial(conduct, respondent, run)
                answered += 1
                told(session)
    finally:
        session.task.station.rig.rest()
    return answered


def _trial(conduct: Conduct, respondent: Respondent, run: int) -> int:
    """One trial; the run that it is of. run: that of the trial before."""
    following = conduct.session.next_trial()
    if following.run != run:
        respondent.begin(following)
    conduct.present(respondent.watch)
    assert conduct.pending is not None
    respondent.presented(conduct.pending[1])
    response = respondent.respond(following.trial)
    acknowledged = conduct.answer(Answer(response, conduct.session.clock.utc()))
    if acknowledged.right is not None:
        respondent.learn(following.trial, acknowledged)
    return following.run

"""Runs a session with a subject who is not at a browser: a person at a terminal, a script, a simulated one."""

from __future__ import annotations

import time
from collections.abc import Callable

from tactuator.experiment.session.presented_session import PresentedSession
from tactuator.experiment.session.session import Session
from tactuator.experiment.session.standing import Acknowledged, NextTrial
from tactuator.experiment.store.answer_records import Answer, PlayedTrial
from tactuator.experiment.trial.trial import Trial


class Respondent:
    """Base of respondents, in which only `respond` has to be written: the rest consents, goes on and learns nothing."""

    def agree(self, consent: str) -> bool:
        """Return whether the subject consents to what the study says."""
        return True

    def pause(self) -> None:
        """Wait until the subject goes on after a break."""

    def begin(self, following: NextTrial) -> None:
        """Take notice that a run begins, or goes on, with that trial."""

    def watch(self, interval: int, begins: bool) -> None:
        """Take notice that an interval begins, or ends."""

    def presented(self, played: PlayedTrial) -> None:
        """Take notice of the trial as it was played."""

    def respond(self, trial: Trial) -> str:
        """Return one of trial.responses, after its intervals were played."""
        raise NotImplementedError

    def learn(self, trial: Trial, told: Acknowledged) -> None:
        """Learn from the outcome after the answer, in runs with feedback."""


def run_session(
    presented: PresentedSession,
    respondent: Respondent,
    told: Callable[[Session], None] = lambda session: None,
    rest: Callable[[float], None] = time.sleep,
) -> int:
    """Run what is left of the session and return how many trials were answered; the rig is then at rest in any case.

    It ends at once where the subject does not consent. told: called after every answer. rest: waits so many seconds
    where a break is not over yet.
    """
    session, run, answered = presented.session, -1, 0
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
                run = _trial(presented, respondent, run)
                answered += 1
                told(session)
    finally:
        session.task.apparatus.rig.rest()
    return answered


def _trial(presented: PresentedSession, respondent: Respondent, run: int) -> int:
    """Run one trial and return its run. run: that of the trial before."""
    following = presented.session.next_trial()
    if following.run != run:
        respondent.begin(following)
    presented.present(respondent.watch)
    assert presented.pending is not None
    respondent.presented(presented.pending[1])
    response = respondent.respond(following.trial)
    acknowledged = presented.answer(Answer(response, presented.session.clock.utc()))
    if acknowledged.right is not None:
        respondent.learn(following.trial, acknowledged)
    return following.run

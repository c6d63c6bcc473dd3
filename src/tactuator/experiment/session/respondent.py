"""A session's run with a subject who is not at a browser: a person at a terminal, a script."""

from __future__ import annotations

import time
from collections.abc import Callable

from tactuator.experiment.session.session import Acknowledged, Session
from tactuator.experiment.session.task import NextTrial
from tactuator.experiment.store.records import Answer, PlayedTrial
from tactuator.experiment.trial import Trial


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

    def learn(self, trial: Trial, acknowledged: Acknowledged) -> None:
        """Learn from the outcome after the answer, in runs with feedback."""


def run_session(
    session: Session,
    respondent: Respondent,
    progress: Callable[[Session], None] = lambda session: None,
    rest: Callable[[float], None] = time.sleep,
) -> int:
    """Run what is left of the session and return how many trials were answered; the rig is then at rest in any case.

    It ends at once where the subject does not consent. progress: called after every answer. rest: waits so many seconds
    where a break is not over yet.
    """
    run, answered = -1, 0
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
                session.introduce()  # `begin` reports it
            else:
                run = _trial(session, respondent, run)
                answered += 1
                progress(session)
    finally:
        session.task.apparatus.rig.rest()
    return answered


def _trial(session: Session, respondent: Respondent, run: int) -> int:
    """Run one trial and return its run. run: that of the trial before."""
    following = session.next_trial()
    if following.run != run:
        respondent.begin(following)
    session.present(respondent.watch)
    assert session.pending is not None
    respondent.presented(session.pending[1])
    acknowledged = session.answer(Answer(respondent.respond(following.trial), session.clock.utc()))
    if acknowledged.right is not None:
        respondent.learn(following.trial, acknowledged)
    return following.run

"""A session at a rig, and its run with a subject who is not at a browser: a person at a terminal, a script."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from tactuator.errors import BadInput, TimingMissed
from tactuator.experiment.presenter import Watch
from tactuator.experiment.session.session import Acknowledged, NextTrial, Session
from tactuator.experiment.store.records import PROGRAM, Answer, PlayedTrial
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
    presented: PresentedSession,
    respondent: Respondent,
    progress: Callable[[Session], None] = lambda session: None,
    rest: Callable[[float], None] = time.sleep,
) -> int:
    """Run what is left of the session and return how many trials were answered; the rig is then at rest in any case.

    It ends at once where the subject does not consent. progress: called after every answer. rest: waits so many seconds
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
                progress(session)
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


_ATTEMPTS_MAX = 3
"""Number of times that a trial is played whose timing the rig misses, before that is a fault of the rig."""


@dataclass
class PresentedSession:
    """A session whose trials are presented at a rig; pending: the trial that was played and waits for its answer."""

    session: Session
    pending: tuple[NextTrial, PlayedTrial] | None = field(init=False, default=None)
    _played: tuple[int, int, int] = field(init=False, default=(0, 0, 0))

    @property
    def introduction(self) -> str:
        """Return the text before the run that comes next, or "" where none does."""
        upcoming = self.session.upcoming
        return "" if upcoming is None else upcoming.introduction

    @property
    def comes(self) -> tuple[str, str]:
        """Return what a page shows before the subject goes on: the stage and the introduction."""
        return self.session.stage, self.introduction

    def present(self, watch: Watch, halted: Callable[[], bool] = lambda: False) -> NextTrial:
        """Play the trial that stands; again, if it was played and never answered, or its timing was missed.

        halted: called while it plays, True to stop it. Raises Halted where it was stopped, the trial then being
        unplayed, and TimingMissed where the rig missed the timing again and again.
        """
        self.pending = None
        following = self.session.next_trial()
        course, clock, outlet = self.session.course, self.session.clock, self.session.task.apparatus.outlet
        assert course is not None
        watch = watch if outlet is None else outlet.watching(watch)
        for attempt in range(_ATTEMPTS_MAX):
            presentations = self._count(following)
            try:
                played = course.play(following.trial, watch, halted, clock.utc())
            except TimingMissed as missed:
                detail = f"run {following.run}, trial {following.trial.number}: {missed}"
                self.session.note("timing-missed", detail, PROGRAM)
                if attempt + 1 == _ATTEMPTS_MAX:
                    raise
                continue
            ended, ended_s = clock.utc(), clock.monotonic_s()
            played = replace(played, ended=ended, ended_s=ended_s, presentations=presentations)
            self.pending = (following, played)
            if outlet is not None:
                outlet.played(following.run, played)
            break
        return following

    def _count(self, following: NextTrial) -> int:
        run, number, times = self._played
        same = (run, number) == (following.run, following.trial.number)
        self._played = (following.run, following.trial.number, times + 1 if same else 1)
        return self._played[2]

    def answer(self, answer: Answer) -> Acknowledged:
        """Save the answer to what was played; see Session.answer.

        Raises BadInput where nothing waits, for an answer that came before its last interval had ended, and for a
        response that was pressed before it was asked for.
        """
        if self.pending is None:
            raise BadInput("no trial waits for an answer", "an answer after its trial")
        played = self.pending[1]
        if answer.received_s is not None and played.ended_s is not None and answer.received_s < played.ended_s:
            early_s = played.ended_s - answer.received_s
            raise BadInput(f"answer {early_s:.3f} s before its last interval had ended", "after it")
        shown_ms, pressed_ms = answer.client_shown_ms, answer.client_pressed_ms
        if shown_ms is not None and pressed_ms is not None and pressed_ms < shown_ms:
            raise BadInput(f"answer {shown_ms - pressed_ms:g} ms before it was asked for", "after that")
        acknowledged = self.session.answer(played, answer)
        self.pending = None
        if (outlet := self.session.task.apparatus.outlet) is not None:
            now_s = self.session.clock.monotonic_s()
            ago_s = 0.0 if answer.received_s is None else now_s - answer.received_s
            outlet.answered(acknowledged.run, played, answer.response, ago_s)
        return acknowledged

    def give_up_run(self) -> None:
        """Stop the run that goes on, and drop what was played and not answered."""
        self.session.stop_run()
        self.pending = None

    def withdraw(self, keep: bool) -> None:
        """End the subject's part in the study, and drop what was played and not answered."""
        self.session.withdraw(keep)
        self.pending = None

"""A session at a rig: presents the trial that stands and keeps what was played until its answer is saved."""

from __future__ import annotations

from dataclasses import dataclass, field

from tactuator.errors import BadInput
from tactuator.experiment.session.session import Acknowledged, NextTrial, Session
from tactuator.experiment.store.records import Answer, Played
from tactuator.experiment.trial.presenter import Watch


@dataclass
class Conduct:
    """Presents and answers trials of one session. pending: what was played and waits for its answer."""

    session: Session
    pending: tuple[NextTrial, Played] | None = field(init=False, default=None)

    def present(self, watch: Watch) -> NextTrial:
        """Play the trial that stands; again, if it was played and never answered."""
        following = self.session.next_trial()
        course = self.session.course
        assert course is not None
        self.pending = (following, course.play(following.trial, watch, self.session.clock.utc()))
        return following

    def answer(self, answer: Answer) -> Acknowledged:
        """Save the answer to what was played; see Session.answer."""
        if self.pending is None:
            raise BadInput("no trial waits for an answer; allowed: an answer after its trial")
        acknowledged = self.session.answer(self.pending[1], answer)
        self.pending = None
        return acknowledged

    def give_up_run(self) -> None:
        """Stop the run that goes on; what was played and not answered is dropped."""
        self.session.stop_run()
        self.pending = None

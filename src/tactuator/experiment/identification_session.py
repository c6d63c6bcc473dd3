"""A subject's way through an identification experiment: present, ask, save, tell; resumed where it stopped."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from tactuator.errors import BadInput
from tactuator.experiment import identification_records as records
from tactuator.experiment.clock import Clock
from tactuator.experiment.conduct import Station
from tactuator.experiment.identification import Block, plan_blocks
from tactuator.experiment.identification_items import LoadedItem, load_items
from tactuator.experiment.identification_protocol import IdentificationProtocol
from tactuator.experiment.presenter import Presenter, Watch
from tactuator.experiment.records import Answer, Found, end_run
from tactuator.experiment.store import Store
from tactuator.experiment.trial import Trial

Progress = Callable[[int, int], None]


class Respondent(Protocol):
    """Who answers: a person at a keyboard, a script, a simulated subject at the finger ports."""

    def begin(self, block: Block) -> None:
        """A block begins."""
        ...

    def respond(self, trial: Trial) -> str:
        """One of trial.responses, after its intervals were played."""
        ...

    def learn(self, trial: Trial, correct: bool) -> None:
        """Told after the answer, in blocks with feedback."""
        ...


@dataclass
class IdentificationStudy:
    """A protocol with its items, on a station, in a store."""

    protocol: IdentificationProtocol
    text: str
    items: Mapping[str, LoadedItem]
    station: Station
    store: Store
    clock: Clock

    @classmethod
    def open(
        cls, protocol: IdentificationProtocol, text: str, beside: Path, station: Station, store: Store, clock: Clock
    ) -> IdentificationStudy:
        """The study with its items read. Raises BadInput as `load_items` does, or where stored items were others."""
        study = cls(protocol, text, load_items(protocol, beside, station.rig), station, store, clock)
        study.sessions()
        return study

    def sessions(self) -> list[Found]:
        """Every subject's session, made in the store if the study is new."""
        tokens = [secrets.token_urlsafe(16) for _ in self.protocol.subject]
        with self.store.begin() as connection:
            study = records.open_study(connection, self.protocol, self.text, self.items, self.clock.utc(), tokens)
            return records.study_sessions(connection, study)

    def run(
        self,
        subject: str,
        respondent: Respondent,
        progress: Progress = lambda done, total: None,
        watch: Watch = lambda interval, begins: None,
    ) -> int:
        """Take a subject through what is left of all blocks; how many trials were answered. However it ends, at rest.

        Raises BadInput for a subject who is not in the protocol.
        """
        session = next((row for row in self.sessions() if row.subject_code == subject), None)
        if session is None:
            codes = ", ".join(one.code for one in self.protocol.subject)
            raise BadInput(f"subject {subject!r} is not in the protocol; allowed: {codes}")
        blocks = plan_blocks(self.protocol, session.subject_number)
        total, done, here = sum(len(block.trials) for block in blocks), 0, 0
        presenter = Presenter(self.station.rig, self.station.rig.channels[0], watch)
        try:
            for block in blocks:
                run, first = self._begin(session.id, block)
                done += first
                progress(done, total)
                if first < len(block.trials):
                    respondent.begin(block)
                for trial in block.trials[first:]:
                    self._trial(presenter, run, block, trial, respondent)
                    done, here = done + 1, here + 1
                    progress(done, total)
                self._end(run)
        finally:
            self.station.rig.rest()
        return here

    def _begin(self, session: int, block: Block) -> tuple[int, int]:
        apparatus = self.station.apparatus(self.station.controller.display.channels[0].finger)
        paradigm = self.protocol.identification.paradigm
        with self.store.begin() as connection:
            run = records.block_run(connection, session, block, paradigm, apparatus, self.clock.utc())
            return run, records.answered(connection, run)

    def _trial(self, presenter: Presenter, run: int, block: Block, trial: Trial, respondent: Respondent) -> None:
        asking = self.protocol.identification
        presented = self.clock.utc()
        references = [self.items[label].reference for label in trial.stimuli]
        traces = presenter.present(references, asking.lead_s, asking.gap_s)
        response = respondent.respond(trial)
        correct = trial.judge(response)
        with self.store.begin() as connection:
            answer = Answer(response, self.clock.utc())
            records.save_trial(connection, run, trial, traces, presented, answer)
        if block.feedback:
            respondent.learn(trial, correct)

    def _end(self, run: int) -> None:
        with self.store.begin() as connection:
            end_run(connection, run, "done", self.clock.utc())

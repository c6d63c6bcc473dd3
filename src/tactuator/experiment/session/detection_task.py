"""Detection as a session's task: runs placed by a procedure, each trial a tone in one of m intervals."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import datetime

from sqlalchemy import Connection

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Procedure
from tactuator.experiment.procedure.up_down import UpDown
from tactuator.experiment.protocol.plan import PlannedRun, plan_runs, run_seed
from tactuator.experiment.protocol.protocol import Protocol
from tactuator.experiment.result.tables import ResultTable, threshold_table
from tactuator.experiment.result.thresholds import thresholds
from tactuator.experiment.session.apparatus import Station
from tactuator.experiment.session.task import Choice, Picture, Question, Rules
from tactuator.experiment.store.records import Played
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import detection_runs
from tactuator.experiment.trial.detection_run import Detection
from tactuator.experiment.trial.presenter import Presenter, Watch
from tactuator.experiment.trial.trial import Trial


@dataclass(frozen=True)
class DetectionTask:
    """A detection protocol at a station. Raises BadInput where the display has no such finger, or cannot play it."""

    protocol: Protocol
    station: Station

    def __post_init__(self) -> None:
        protocol, rig = self.protocol, self.station.rig
        for finger in protocol.conditions.fingers:
            low, high = self.station.channel(finger).threshold.band_hz
            for frequency in protocol.conditions.frequencies_hz:
                if not low <= frequency <= high:
                    raise BadInput(f"{frequency:g} Hz on finger {finger!r}; allowed: {low:g} to {high:g} Hz")
        if protocol.masker is not None and protocol.masker.channel not in (None, *rig.channels):
            raise BadInput(f"masker: channel {protocol.masker.channel!r}; allowed: {', '.join(rig.channels)}")

    @property
    def question(self) -> Question:
        """One key for each interval."""
        responses = self.protocol.forced_choice().responses
        choices = tuple(Choice(response, (response,)) for response in responses)
        return Question("Which interval has the vibration?", choices, responses)

    @property
    def rules(self) -> Rules:
        """As the protocol has them."""
        session = self.protocol.session
        return Rules(
            feedback_s=self.protocol.timing.feedback_s,
            break_after_trials=session.break_after_trials,
            break_s=session.break_s,
            resume_within_s=session.resume_within_s,
        )

    def enrol(self, connection: Connection, study: int) -> None:
        """A detection study has nothing besides its sessions."""

    def runs(self, subject: int) -> tuple[PlannedRun, ...]:
        """Practice, then every condition in the subject's order."""
        return plan_runs(self.protocol, subject)

    def course(self, planned: PlannedRun, subject: int, attempt: int) -> DetectionCourse:
        """A fresh procedure."""
        protocol = self.protocol
        if planned.practice:
            procedure: Procedure = protocol.practice(planned.frequency_hz or 100.0)
        else:
            procedure = protocol.procedure.build(protocol.forced_choice(), self.station.band_hz)
        return DetectionCourse(self, planned, procedure, run_seed(protocol, subject, planned.position, attempt))

    def results(self, store: Store, session: int) -> tuple[ResultTable, ...]:
        """The thresholds of the runs that are done."""
        found = thresholds([run for run in detection_runs(store) if run.session.id == session])
        if not found:
            raise BadInput("the session has no run that is done; allowed: results after the first")
        return (threshold_table(found),)


@dataclass
class DetectionCourse:
    """One run: its procedure, and what became of its trials."""

    task: DetectionTask
    planned: PlannedRun
    procedure: Procedure
    seed: tuple[int, ...]
    _outcomes: list[tuple[float, bool]] = field(init=False, default_factory=list)

    @property
    def trials(self) -> int:
        """Answered so far."""
        return self.procedure.trials

    @property
    def progress(self) -> float:
        """The procedure's."""
        return self.procedure.progress

    def trial(self) -> Trial | None:
        """The trial where the procedure puts it, at the run's frequency unless the procedure chooses that too."""
        placement = self.procedure.placement()
        if placement is None:
            return None
        if placement.frequency_hz is None:
            placement = replace(placement, frequency_hz=self.planned.frequency_hz)
        return self.task.protocol.forced_choice().trial(self.procedure.trials, placement, self.seed)

    def play(self, trial: Trial, watch: Watch, presented: datetime) -> Played:
        """Play the trial's intervals on the channel of the run's finger."""
        assert trial.placement is not None
        assert trial.placement.frequency_hz is not None
        frequency, protocol = trial.placement.frequency_hz, self.task.protocol
        channel = self.task.station.channel(self.planned.finger)
        presenter = Presenter(self.task.station.rig, channel.name, watch)
        masker = None if protocol.masker is None else protocol.masker.build()
        detection = Detection(presenter, channel, protocol.timing.build(), protocol.forced_choice(), masker)
        intervals = detection.play(trial, frequency, self.seed)
        level = float(channel.threshold.curve.level_db_re_1um_at(frequency))
        return Played(trial, intervals, presented, frequency, level)

    def record(self, response: str) -> None:
        """Right or wrong moves the procedure on."""
        trial = self.trial()
        if trial is None or trial.placement is None:
            raise BadInput("the run is over; allowed: a response to a trial that stands")
        correct = trial.judge(response)
        self._outcomes.append((trial.placement.level_db_sl, correct))
        self.procedure.record(correct)

    def picture(self) -> Picture:
        """Level and outcome of every trial."""
        turned = f", {len(self.procedure.reversal_levels)} reversals" if isinstance(self.procedure, UpDown) else ""
        return {
            "kind": "track",
            "title": f"{self.planned.title}, {self.trials} trials{turned}",
            "levels_db_sl": [level for level, _ in self._outcomes],
            "correct": [correct for _, correct in self._outcomes],
        }

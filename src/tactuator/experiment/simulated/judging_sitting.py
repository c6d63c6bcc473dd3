"""Simulated people of a law of strength whose fingers are on a simulated display, and a whole study with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import protocol_hash
from tactuator.experiment.protocol.judging import JudgingProtocol
from tactuator.experiment.session.judging_task import JudgingTask
from tactuator.experiment.session.presented_session import PresentedSession, Respondent, run_session
from tactuator.experiment.session.session import NextTrial
from tactuator.experiment.session.studies import open_session, open_study
from tactuator.experiment.session.task import Apparatus, Clock
from tactuator.experiment.simulated.strength_people import StrengthPerson
from tactuator.experiment.store.records import PlayedTrial, Sitting
from tactuator.experiment.store.store import Store
from tactuator.experiment.task.task_keys import JudgedTone, Judgement
from tactuator.experiment.trial.presenter import amplitude
from tactuator.experiment.trial.trial import IntervalRecord, Trial, trial_rng
from tactuator.rig.rig import require_finger_ports
from tactuator.signals.decibels import db

_LEAST_MM, _UM_PER_MM = 1e-12, 1000.0


def run_judging(
    store: Store,
    protocol: JudgingProtocol,
    text: str,
    apparatus: Apparatus,
    people: Sequence[StrengthPerson],
    clock: Clock,
    load: str | None = None,
    show: Callable[[int, float], None] = lambda subject, share: None,
) -> int:
    """Take everybody through their session, resumed if it was begun, and return the study's row in the store.

    load: put on the display's ports while fingers are there. show: called with the subject's place and its progress.
    Raises BadInput where there are not as many people as subjects.
    """
    require_finger_ports(apparatus.rig, apparatus.name)
    if len(people) != len(protocol.subject):
        raise BadInput(f"{len(people)} people for {len(protocol.subject)} subjects", "as many")
    task, mark = JudgingTask(protocol, apparatus), protocol_hash(text)[:12]
    study = open_study(store, task, text, clock, lambda code, visit: f"simulated-{mark}-{code}-{visit}")
    for place, (subject, person) in enumerate(zip(protocol.subject, people, strict=True)):
        session, judge = open_session(study, subject.code, sitting=Sitting("simulated")), JudgeAtRig(person, task, load)
        try:
            run_session(PresentedSession(session), judge, lambda now: show(place, now.progress))  # noqa: B023
        finally:
            judge.leave()
    return study.id


class JudgeAtRig(Respondent):
    """A person whose fingers are on every channel that the task uses.

    Of an interval with one tone it feels the peak displacement at the tone's frequency, hum, noise and friction
    included, against the display's threshold curve; of the others what was commanded.
    """

    def __init__(self, person: StrengthPerson, task: JudgingTask, load: str | None) -> None:
        self._person, self._task, self._load = person, task, load
        self._felt_mm: dict[str, list[FloatArray]] = {}
        self._attached: dict[str, Callable[[FloatArray], None]] = {}

    def begin(self, following: NextTrial) -> None:
        """Put the fingers on the display."""
        self.leave()
        self._seed = following.seed
        for finger in self._task.protocol.task.fingers_used():
            blocks: list[FloatArray] = []
            channel = self._task.apparatus.channel(finger).name
            port = self._task.apparatus.rig.finger(channel)
            port.touch(self._load)
            self._felt_mm[channel], self._attached[channel] = blocks, blocks.append
            port.attach(self._attached[channel])

    def presented(self, played: PlayedTrial) -> None:
        """Keep the trial's intervals as they were played."""
        self._played = played

    def respond(self, trial: Trial) -> str:
        """Return the person's answer, and forget what was felt so far."""
        assert isinstance(trial, Judgement)
        whole = {channel: np.concatenate(blocks) for channel, blocks in self._felt_mm.items()}
        levels = [
            self._level_db_sl(tones, record, whole)
            for tones, record in zip(trial.tones, self._played.intervals, strict=True)
        ]
        for blocks in self._felt_mm.values():
            blocks.clear()
        return self._person.answer(trial, levels, trial_rng((*self._seed, 1), trial.number))

    def _level_db_sl(self, tones: Sequence[JudgedTone], record: IntervalRecord, whole: dict[str, FloatArray]) -> float:
        tone, apparatus = tones[0], self._task.apparatus
        if len(tones) != 1:
            return tone.level_db_sl
        assert record.onset_s is not None
        assert record.duration_s is not None
        channel, rate_hz = apparatus.channel(tone.finger), apparatus.rig.rate_hz
        felt = whole[channel.name]
        onset = felt.size - round(self._played.lasted_s * rate_hz) + round(record.onset_s * rate_hz)
        stretch = felt[onset : onset + round(record.duration_s * rate_hz)]
        ramp_s = tone.ramp_s(self._task.protocol.timing)
        peak_um = max(amplitude(stretch, tone.frequency_hz, rate_hz, ramp_s), _LEAST_MM) * _UM_PER_MM
        return float(db(peak_um) - channel.threshold.curve.level_db_re_1um_at(tone.frequency_hz))

    def leave(self) -> None:
        """Take the fingers off the display."""
        for channel, attached in self._attached.items():
            port = self._task.apparatus.rig.finger(channel)
            port.detach(attached)
            port.touch(None)
        self._attached.clear()
        self._felt_mm.clear()

"""A session at a rig: presents the trial that stands and keeps what was played until its answer is saved."""

from __future__ import annotations

from dataclasses import dataclass, field

from tactuator.digital.controller import Controller
from tactuator.errors import BadInput
from tactuator.experiment.clock import Clock
from tactuator.experiment.detection import Detection
from tactuator.experiment.presenter import Presenter, Watch
from tactuator.experiment.protocol import Protocol
from tactuator.experiment.records import Answer, Apparatus, Played
from tactuator.experiment.session import Acknowledged, NextTrial, Session
from tactuator.experiment.timing import Timing
from tactuator.files.controller import controller_hash
from tactuator.plant.display import Channel
from tactuator.rig.protocol import Rig


@dataclass(frozen=True)
class Station:
    """A rig with a controller loaded, and its name."""

    rig: Rig
    controller: Controller
    name: str

    def channel(self, finger: str) -> Channel:
        """The channel for that finger; BadInput if the display has none."""
        for channel in self.controller.display.channels:
            if channel.finger == finger:
                return channel
        fingers = ", ".join(channel.finger for channel in self.controller.display.channels)
        raise BadInput(f"finger {finger!r} is not on the display; allowed: {fingers}")

    def apparatus(self, finger: str) -> Apparatus:
        """What is stored with a run on that finger."""
        channel = self.channel(finger)
        curve = channel.threshold.curve
        return Apparatus(
            self.name,
            self.controller.display.name,
            controller_hash(self.controller),
            curve.name,
            curve.content_hash,
            channel.sensor_gain_v_per_mm,
            *self.band_hz,
        )

    def check(self, protocol: Protocol) -> None:
        """BadInput where the display has no such finger, or cannot play a frequency."""
        for finger in protocol.conditions.fingers:
            low, high = self.channel(finger).threshold.band_hz
            for frequency in protocol.conditions.frequencies_hz:
                if not low <= frequency <= high:
                    raise BadInput(f"{frequency:g} Hz on finger {finger!r}; allowed: {low:g} to {high:g} Hz")
        if protocol.masker is not None and protocol.masker.channel not in (None, *self.rig.channels):
            raise BadInput(f"masker: channel {protocol.masker.channel!r}; allowed: {', '.join(self.rig.channels)}")

    @property
    def band_hz(self) -> tuple[float, float]:
        """The band of the display's first channel."""
        return self.controller.display.channels[0].threshold.band_hz


@dataclass
class Conduct:
    """Presents and answers trials of one session. pending: what was played and waits for its answer."""

    session: Session
    station: Station
    clock: Clock
    pending: tuple[NextTrial, Played] | None = field(init=False, default=None)

    @property
    def timing(self) -> Timing:
        """The protocol's."""
        return self.session.protocol.timing.build()

    def present(self, watch: Watch) -> NextTrial:
        """Play the trial that stands; again, if it was played and never answered."""
        following = self.session.next_trial()
        channel = self.station.channel(following.planned.finger)
        presenter = Presenter(self.station.rig, channel.name, watch)
        masker = self.session.protocol.masker
        detection = Detection(
            presenter,
            channel,
            self.timing,
            self.session.protocol.forced_choice(),
            None if masker is None else masker.build(),
        )
        presented = self.clock.utc()
        intervals = detection.play(following.trial, following.frequency_hz, following.seed)
        level = float(channel.threshold.curve.level_db_re_1um_at(following.frequency_hz))
        self.pending = (following, Played(following.trial, following.frequency_hz, level, intervals, presented))
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

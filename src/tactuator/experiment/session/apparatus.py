"""The apparatus that stimuli are played with: a rig with a controller loaded."""

from __future__ import annotations

from dataclasses import dataclass

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Playable
from tactuator.experiment.protocol.plan import ALL_FINGERS
from tactuator.experiment.store.run_records import ApparatusRecord
from tactuator.experiment.trial.timing import Timing
from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.rig.paced import Paced
from tactuator.rig.rig import Rig
from tactuator.rig.touchable import TouchableRig


@dataclass(frozen=True)
class Apparatus:
    """A rig with a controller loaded, and its name."""

    rig: Rig
    controller: Controller
    name: str

    def channel(self, finger: str) -> Channel:
        """Return the channel for that finger (the first for all of them). Raises BadInput if the display has none."""
        for channel in self.controller.display.channels:
            if finger in (channel.finger, ALL_FINGERS):
                return channel
        fingers = ", ".join(channel.finger for channel in self.controller.display.channels)
        raise BadInput(f"finger {finger!r} is not on the display", f"{fingers}")

    def record(self, finger: str) -> ApparatusRecord:
        """Return the description of the apparatus that is stored with a run on that finger."""
        channel = self.channel(finger)
        curve = channel.threshold.curve
        return ApparatusRecord(
            self.name,
            self.controller.display.name,
            self.controller.content_hash,
            curve.name,
            curve.content_hash,
            channel.sensor_gain_v_per_mm,
            *self.band_hz,
            self.simulated,
            self.rig.rate_hz,
            self.rig.speed if isinstance(self.rig, Paced) else None,
        )

    def playable(self, timing: Timing) -> Playable:
        """Return the range of stimuli of that timing that a procedure which chooses frequencies may use."""
        return Playable(self.band_hz, self.mains_hz, timing.clearance_hz(self.mains_hz or 100.0))

    @property
    def mains_hz(self) -> float:
        """Return the fundamental of the hum that the display's first channel is said to have; 0 for none."""
        return min(self.controller.display.channels[0].environment.hum_hz, default=0.0)

    @property
    def simulated(self) -> bool:
        """Return whether the display is simulated, so that nobody can feel anything there."""
        return isinstance(self.rig, TouchableRig) and self.rig.has_finger_ports

    @property
    def band_hz(self) -> tuple[float, float]:
        """Return the band of the display's first channel."""
        return self.controller.display.channels[0].threshold.band_hz

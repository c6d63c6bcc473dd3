"""A rig with a controller loaded: where stimuli are played."""

from __future__ import annotations

from dataclasses import dataclass

from tactuator.display.controller import Controller
from tactuator.display.description import Channel
from tactuator.errors import BadInput
from tactuator.experiment.protocol.plan import ALL_FINGERS
from tactuator.experiment.store.records import Apparatus
from tactuator.files.controller import controller_hash
from tactuator.rig.rig import Rig


@dataclass(frozen=True)
class Station:
    """A rig with a controller loaded, and its name."""

    rig: Rig
    controller: Controller
    name: str

    def channel(self, finger: str) -> Channel:
        """The channel for that finger (the first for all of them); BadInput if the display has none."""
        for channel in self.controller.display.channels:
            if finger in (channel.finger, ALL_FINGERS):
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

    @property
    def band_hz(self) -> tuple[float, float]:
        """The band of the display's first channel."""
        return self.controller.display.channels[0].threshold.band_hz

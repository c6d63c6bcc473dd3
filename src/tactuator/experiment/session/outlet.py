"""Onsets, levels and answers of sessions for other recorders in the room, by Lab Streaming Layer (the extra `lsl`).

Two streams carry the same events with the same time stamps: one names them, the other has their numbers. They are
described as XDF, the format of LSL's recorders, expects. A trial is told when it is over, with the times of its onsets.
"""

from __future__ import annotations

import math
import os
import socket
import time
from collections.abc import Mapping
from importlib import import_module
from typing import Any

from tactuator.errors import BadInput
from tactuator.experiment.store.records import PlayedTrial
from tactuator.experiment.trial.presenter import Watch
from tactuator.rig.rig import Rig

UNITS: Mapping[str, str] = {
    "run": "",
    "trial": "",
    "interval": "",
    "presentation": "",
    "frequency_hz": "Hz",
    "commanded_db_sl": "dB SL",
    "measured_db_sl": "dB SL",
    "rig_s": "s",
    "correct": "",
}
"""Channels of the numbers with their units; run, trial and interval are those of the store."""

THIS_MACHINE = """
[ports]
IPv6 = disable
[multicast]
ResolveScope = machine
AddressesOverride = {127.0.0.1}
ListenAddress = 127.0.0.1
Interfaces = lo
TTLOverride = 0
[lab]
KnownPeers = {127.0.0.1}
[log]
level = -2
"""
"""Settings of LSL that look for recorders, and are found, on this machine alone."""

_LAST_SENT_S = 0.2


class Outlet:
    """Two streams of a rig; nobody need listen. name: of the rig, for people. display: its display's.

    A simulated rig without a pace has its own time in the stamps, which then begin at the present. Raises BadInput
    where pylsl is missing.
    """

    def __init__(self, rig: Rig, name: str, display: str) -> None:
        try:
            self._lsl: Any = import_module("pylsl")
        except (ImportError, RuntimeError):  # the latter where it has not its library
            raise BadInput("pylsl is missing", "install it with `pip install tactuator[lsl]`") from None
        if "LSLAPICFG" not in os.environ:
            self._lsl.util.set_config_content(THIS_MACHINE)
        self._rate_hz, self._speed = rig.rate_hz, rig.speed or 1.0
        self._has_rigs_time = rig.has_finger_ports and rig.speed is None
        self._zero_s: float | None = None
        self._reported_s: dict[int, float] = {}
        self._over_s = 0.0
        self._events = self._stream("markers", "Markers", "string", {"event": ""}, name, display)
        self._numbers = self._stream("levels", "Levels", "double64", UNITS, name, display)

    def _stream(self, suffix: str, kind: str, form: str, channels: Mapping[str, str], name: str, display: str) -> Any:
        source = f"tactuator {name} on {socket.gethostname()}: {suffix}"  # by which a recorder knows it after a restart
        info = self._lsl.StreamInfo(f"tactuator-{suffix}", kind, len(channels), 0.0, form, source)
        about = info.desc()
        listed = about.append_child("channels")
        for label, unit in channels.items():
            channel = listed.append_child("channel")
            for key, value in (("label", label), ("unit", unit), ("type", kind.removesuffix("s"))):
                channel.append_child_value(key, value)
        made_by = about.append_child("acquisition")
        for key, value in (("manufacturer", "tactuator"), ("model", display), ("rig", name)):
            made_by.append_child_value(key, value)
        about.append_child("synchronization").append_child_value("can_drop_samples", "false")
        return self._lsl.StreamOutlet(info)

    def wait_for_recorder(self) -> None:
        """Wait until somebody listens to both streams: what is sent before is heard by nobody."""
        for stream in (self._events, self._numbers):
            while not stream.wait_for_consumers(1.0):
                pass

    def watching(self, watch: Watch) -> Watch:
        """Return the watch of a trial, by whose calls the rig's time is known in LSL's."""

        def reported(interval: int, begins: bool) -> None:
            if begins:
                self._reported_s[interval] = self._lsl.local_clock()
            watch(interval, begins)

        return reported

    def played(self, run: int, played: PlayedTrial) -> None:
        """Tell the onsets of a trial of that run, which was just played under `watching`."""
        begun_s, tick = self._begun_s(played), played.rig_tick
        self._over_s = begun_s + played.lasted_s / self._speed
        for place, interval in enumerate(played.intervals):
            onset_s = interval.onset_s or 0.0
            numbers = (
                *(run, played.trial.number, place, played.presentations, played.frequency_hz),
                *(interval.commanded_db_sl, interval.measured_db_sl),
                *(None if tick is None else tick / self._rate_hz + onset_s, None),
            )
            self._push(f"onset/{interval.stimulus}", numbers, begun_s + onset_s / self._speed)

    def answered(self, run: int, played: PlayedTrial, response: str, ago_s: float) -> None:
        """Tell the answer to a trial, which came so long ago."""
        stamp_s = self._over_s if self._has_rigs_time else self._lsl.local_clock() - ago_s
        numbers = (run, played.trial.number, None, played.presentations, played.frequency_hz, None, None, None)
        self._push(f"answer/{response}", (*numbers, played.trial.judge(response)), stamp_s)

    def _begun_s(self, played: PlayedTrial) -> float:
        """Return when the trial's first sample was played, by LSL's clock: as the promptest report of an onset has it.

        A report can come late, never early.
        """
        if self._has_rigs_time:
            tick_s = (played.rig_tick or 0) / self._rate_hz
            if self._zero_s is None:
                self._zero_s = self._lsl.local_clock() - tick_s
            return self._zero_s + tick_s
        at_s = [(interval.onset_s or 0.0) + (interval.lamp_late_s or 0.0) for interval in played.intervals]
        return min(self._reported_s[place] - after_s / self._speed for place, after_s in enumerate(at_s))

    def _push(self, event: str, numbers: tuple[float | None, ...], stamp_s: float) -> None:
        self._events.push_sample([event], stamp_s)
        self._numbers.push_sample([math.nan if number is None else float(number) for number in numbers], stamp_s)

    def close(self) -> None:
        """End the streams, once what was pushed last is sent."""
        if self._events.have_consumers() or self._numbers.have_consumers():
            time.sleep(_LAST_SENT_S)
        del self._events, self._numbers

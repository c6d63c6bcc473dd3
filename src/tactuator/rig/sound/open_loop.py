"""A controller without loop, run on the host: references to volts, within comfort, range and travel."""

from __future__ import annotations

import numpy as np
from scipy import signal

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import ChannelController, Controller
from tactuator.model.description import Channel
from tactuator.model.load import DERIVATIVES
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.signals.decibels import db, from_db
from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.systems import ContinuousSystem

_ROUNDING = 1.001
_RING_S, _RING_DB, _FADE_S = 0.5, -80.0, 0.02
_SLOWEST = 0.5
"""Share of the band's lower edge below which a sensor of velocity or acceleration does not tell of displacement."""


class OpenLoop:
    """The channels of a controller whose F gives the command itself. Raises BadInput for a closed loop."""

    def __init__(self, controller: Controller) -> None:
        self._channels = [
            _OpenChannel(described, own, controller.rate_hz)
            for described, own in zip(controller.display.channels, controller.channels, strict=True)
        ]
        self._names = [channel.name for channel in controller.channels]
        self._held = np.zeros((controller.delay_samples, len(self._names)))
        comfort_db_sl = min(COMFORT_DB_SL, *(one.limits.comfort_db_sl for one in controller.channels))
        self._most = _ROUNDING * float(from_db(comfort_db_sl))
        self._comfort_db_sl = comfort_db_sl
        self._rate_hz = controller.rate_hz
        self.reset()

    def reset(self) -> None:
        """Bring every state to rest."""
        self._held[:] = 0.0
        for channel in self._channels:
            channel.reset()

    def command(self, reference: FloatArray) -> tuple[FloatArray, np.ndarray[tuple[int, ...], np.dtype[np.bool_]]]:
        """Return the volts (n, channels) for a reference (n, channels), threshold units, and where they were cut to the
        command's limit.

        Raises BadInput for a reference beyond comfort, and for one that takes a channel beyond its travel by the
        display's model.
        """
        peak = float(np.max(np.abs(reference), initial=0.0))
        if peak > self._most:
            raise BadInput(
                f"the reference reaches {float(db(peak)):.1f} dB SL", f"comfort, {self._comfort_db_sl:g} dB SL"
            )
        made = [channel.command(column) for channel, column in zip(self._channels, reference.T, strict=True)]
        wanted = np.column_stack([volts for volts, _ in made])
        limited = np.column_stack([cut for _, cut in made])
        later = np.concatenate([self._held, wanted])
        self._held = later[len(wanted) :].copy()
        return later[: len(wanted)], limited

    def ringing(self) -> FloatArray:
        """Return the volts (n, channels) by which the controller dies away from here, faded out at their end."""
        count = round(_RING_S * self._rate_hz)
        volts, _ = self.command(np.zeros((count, len(self._names))))
        level = np.max(np.abs(volts), axis=1)
        loud = np.flatnonzero(level > float(from_db(_RING_DB)) * max(1e-9, float(np.max(level, initial=0.0))))
        fade = min(count, round(_FADE_S * self._rate_hz))
        end = min(count, int(loud[-1]) + 1 + fade if loud.size else fade)
        line = np.ones(end)
        line[-fade:] = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, fade + 1) / fade)
        return np.asarray(volts[:end] * line[:, None])


class _OpenChannel:
    def __init__(self, channel: Channel, own: ChannelController, rate_hz: float) -> None:
        if own.feedback_sos is not None:
            raise BadInput(
                f"channel {own.name!r}: the controller closes a loop, and a sound card answers tens of milliseconds "
                "late",
                'structure = "none" in [feedback]',
            )
        self._name, self._limits, self._travel_mm = own.name, own.limits, channel.travel_mm
        self._prefilter = own.prefilter_sos / own.prefilter_sos[:, 3:4]
        self._moves = displacement_sections(channel, rate_hz)
        self.reset()

    def reset(self) -> None:
        """Bring the states to rest."""
        self._state = np.zeros((len(self._prefilter), 2))
        self._moved = [np.zeros((len(sections), 2)) for sections in self._moves]

    def command(self, reference: FloatArray) -> tuple[FloatArray, np.ndarray[tuple[int, ...], np.dtype[np.bool_]]]:
        """Return the volts (n,) and where they were cut. Raises BadInput beyond the travel."""
        wanted, self._state = signal.sosfilt(self._prefilter, reference, zi=self._state)
        volts = np.clip(wanted, -self._limits.command_v, self._limits.command_v)
        moved = volts
        for k, sections in enumerate(self._moves):
            moved, self._moved[k] = signal.sosfilt(sections, moved, zi=self._moved[k])
        reach = float(np.max(np.abs(moved), initial=0.0))
        if reach > _ROUNDING * self._travel_mm:
            raise BadInput(
                f"channel {self._name!r}: the reference moves it by {reach:.3g} mm by the display's model",
                f"its travel, {self._travel_mm:g} mm",
            )
        return np.asarray(volts), np.asarray(volts != wanted)


def displacement_sections(channel: Channel, rate_hz: float) -> tuple[FloatArray, ...]:
    """Return the sections, cascade after cascade, from volts of command to millimetres at the finger by the channel's
    model: its plant without dead time, integrated as often as the sensor has differentiated.

    A sensor of velocity or acceleration does not tell what moves slowly: below half the band's lower edge the integral
    is let go, s / (s + w)^2 in the place of 1 / s, with 1.25 times its gain so that nothing in the band is told for
    less than it is. Raises BadInput for a plant that is not stable, whose travel no open loop can hold.
    """
    plant = channel.plant
    if not plant.is_stable:
        raise BadInput(
            f"channel {channel.name!r}: its plant is not stable, and nothing holds its travel without a loop",
            "a stable plant",
        )
    still = ContinuousSystem(plant.zeros, plant.poles, plant.gain / channel.sensor_gain_v_per_mm)
    cascades = [_normalised(zero_order_hold(still, rate_hz).sections())]
    slowest = 2.0 * np.pi * _SLOWEST * channel.threshold.band_hz[0]
    let_go = ContinuousSystem(np.zeros(1), np.array([-slowest, -slowest]), 1.0 + _SLOWEST**2)
    once = bilinear(let_go, rate_hz).sections()
    return (*cascades, *([_normalised(once)] * DERIVATIVES[channel.quantity]))


def _normalised(sections: FloatArray) -> FloatArray:
    return np.asarray(sections / sections[:, 3:4])

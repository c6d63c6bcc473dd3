"""A display without loop on a sound card, as a rig."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import TypeVar

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, DeviceFault
from tactuator.model.controller import Controller
from tactuator.model.description import Channel, Display
from tactuator.model.plant import DERIVATIVES
from tactuator.model.requirements import SoundCard
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.rig.rig import COMFORT_TOLERANCE, Rig, Trace, join_traces, take_rows
from tactuator.rig.sound.cards import find_card, lasting_name, list_cards, sound_name
from tactuator.rig.sound.stream import POLL_S, CardGone, CardPort, CardRows, CardRun, Port, Rows, SoundGap
from tactuator.runtime.simulation import block_samples, take_command, take_reference
from tactuator.signals.decibels import db, from_db
from tactuator.signals.discretise import discretise
from tactuator.signals.systems import ContinuousSystem

CLIPPED = 0.9999
"""Share of full scale from which an input counts as clipped: the top code of 16 bits is above it."""
SOFT_S = 0.02
"""A command of a drive is faded in so long: a step would ring in every mode."""
PATIENT_S = 4.0
"""How far an unattended measurement is fed ahead: the designs and transforms between two blocks take less."""
TRIES = 8
"""Where two runs in three have a gap, on a busy machine, one stretch in 26 fails; of three tries, one in 3 would."""
RING_S = 4.0 * PATIENT_S
"""Length of the rings: what is taken in may wait for the program four times as long as it is fed ahead."""
_RING_S, _RING_DB, _FADE_S = 0.5, -80.0, 0.02
"""A controller dies away for half a second at most, to 80 dB below its loudest, and its end is faded: below threshold
for what begins at comfort, 55 dB SL."""
_SLOWEST = 0.5
"""Share of the band's lower edge below which a velocity or acceleration sensor does not show displacement."""
Flags = NDArray[np.bool_]
Answer = TypeVar("Answer")
_Piece = tuple[FloatArray, FloatArray, Flags]
"""Reference, command in volts, and where it was cut, each (n, channels)."""


def sound_rig(spec: str, display: Display, seed: int = 0) -> SoundRig:
    """Return the rig of `display` on the card DEVICE[@RATE]; without a device, on the one that [sound] names. The rig's
    display names its card.

    Raises BadInput for a card that is not there or has too few channels, for another than [sound] names, whose volts at
    full scale are not known, for a rate that is not the display's, and where a loop is asked for; DeviceFault where the
    card cannot be opened.
    """
    del seed  # nothing is drawn
    card = sound_wiring(display)
    name, rate_hz = sound_name(spec)
    if rate_hz is not None and rate_hz != display.rate_hz:
        raise BadInput(f"sound card at {rate_hz:g} Hz", f"the display's rate_hz, {display.rate_hz:g} Hz")
    for channel in display.channels:
        if channel.feedback.structure != "none":
            raise BadInput(
                f"channel {channel.name!r}: structure is {channel.feedback.structure!r}, and a loop through a sound "
                "card answers tens of milliseconds late",
                'structure = "none" in [feedback]',
            )
    cards = list_cards()
    out = find_card(name or card.device, cards)
    if card.device and out != (calibrated := find_card(card.device, cards)):
        raise BadInput(
            f"sound card {out.full_name!r}",
            f"{calibrated.full_name!r}, the device in [sound], to which the volts at full scale belong; calibrate "
            "another one first (docs/sound.md)",
        )
    outputs = max(wires.output for wires in card.wires)
    inputs = max(wires.input for wires in card.wires)
    taken_from = find_card(card.input_device, cards) if card.input_device else out
    rows = CardRows(outputs, inputs, round(RING_S * display.rate_hz), display.rate_hz)
    port = CardPort(out, taken_from if inputs else None, outputs, inputs, display.rate_hz, rows)
    named = replace(card, device=lasting_name(out, cards))
    if card.input_device:
        named = replace(named, input_device=lasting_name(taken_from, cards))
    return SoundRig(replace(display, sound=named), rows, port)


def sound_wiring(display: Display) -> SoundCard:
    """Return the display's wiring. Raises BadInput where it has none."""
    if display.sound is None:
        raise BadInput(
            f"display {display.name!r} does not say how it is wired to a sound card",
            "a table [sound] with output_full_scale_v (docs/sound.md)",
        )
    return display.sound


class SoundRig(Rig):
    """The rig of `display` on the card that calls back into `rows`.

    Time goes on: between blocks nothing is put out, and what must not be cut is a stream. A row of a trace is an
    instant of the card's clock; what is taken in is put back by the display's latency_samples. A run with a gap raises
    SoundGap, and `drive` repeats it first, as `repeated` does. allow_gaps: gaps that the card reports are counted
    (`gaps`), and the run continues.
    """

    def __init__(
        self, display: Display, rows: CardRows, port: Port, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        super().__init__(display)
        self._rows, self._port = rows, port
        self._card = sound_wiring(display)
        pairs = zip(self.channels, self._card.wires, strict=True)
        self.without_sensor = tuple(name for name, wires in pairs if not wires.input)
        self._run = CardRun(rows, max(1, round(self._card.lead_s * display.rate_hz)), sleep)
        self._loop: OpenLoop | None = None
        self._active: Iterator[Trace] = iter(())
        self._length = 0
        self.allow_gaps = False
        self.gaps = 0

    @property
    def lead_s(self) -> float:
        """Time by which a run is fed ahead; no less than three looks at the rings."""
        return self._run.lead / self.rate_hz

    @lead_s.setter
    def lead_s(self, seconds: float) -> None:
        self._run.lead = max(1, round(max(seconds, 3.0 * POLL_S) * self.rate_hz))

    def feed_far_ahead(self) -> None:
        """Feed PATIENT_S ahead from now on, as unattended measurements do: computing between two blocks may
        then take as long. Nothing is changed where the rings are shorter.
        """
        wanted = round(PATIENT_S * self.rate_hz)
        self._run.lead = max(self._run.lead, min(wanted, self._rows.capacity // 2))

    def put_back(self, latency_samples: int) -> None:
        """Put what is taken in back by so many samples from now on, in the place of the display's own latency_samples.

        Raises BadInput for less than none.
        """
        self._card = replace(self._card, latency_samples=latency_samples)
        self.display = replace(self.display, sound=self._card)

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs, from rest. Raises BadInput for another rig's, or a loop."""
        self.require_runs(controller)
        controller.require_limits_of(self.display)
        self.rest()
        self._loop, self._loaded = OpenLoop(controller), True

    def play(self, reference: ArrayLike) -> Trace:
        """Play a reference (n, channels), threshold units, through the loaded controller, from rest.

        Raises BadInput for what `take_reference` refuses, beyond comfort or beyond the travel; SoundGap and CardGone.
        """
        return join_traces(self.stream([reference]), self.rate_hz, self.channels)

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Stream blocks as `Rig.stream` does; a block is played lead_s after it was asked for.

        Raises as `play` does.
        """
        self._require_controller()
        return self._begin(self._played(blocks))

    def drive(self, command_v: ArrayLike) -> Trace:
        """Drive the motors with a command (n, channels), volts, from rest; its first 20 ms are faded in, as the trace
        shows. A run with a gap is repeated.

        Raises BadInput for what is not finite and where an input clips; SoundGap and CardGone.
        """
        rows = take_command(block_samples(command_v, len(self.channels), "command"))
        trace = self.repeated(lambda: join_traces(self._begin(self._driven(rows)), self.rate_hz, self.channels))
        self._refuse_clipped(trace)
        return trace

    def repeated(self, ask: Callable[[], Answer]) -> Answer:
        """Return what `ask` gives, an unattended run. After a gap it is asked again, fed twice as far ahead
        each time, TRIES in all; then SoundGap is raised.
        """
        lead = self._run.lead
        try:
            for _ in range(TRIES - 1):
                with suppress(SoundGap):
                    return ask()
                self.rest()
                self._run.lead = min(2 * self._run.lead, max(lead, self._rows.capacity // 2))
            return ask()
        finally:
            self._run.lead = lead

    def rest(self) -> None:
        """Let what is put out die away, and wait until it has."""
        close = getattr(self._active, "close", None)
        if close is not None:
            close()
        self._active = iter(())
        if self._run.alive:
            self._rows.stop()
            self._run.settle()
        if self._loop is not None:
            self._loop.reset()

    def close(self) -> None:
        """Let what is put out die away as far as the card can be reached, and let go of it. A card that fails in this
        has answered all that was asked of it, and nothing is raised.
        """
        try:
            with suppress(CardGone):
                self.rest()
        finally:
            with suppress(DeviceFault):
                self._port.close(self._run.alive)

    # -- runs ---------------------------------------------------------------------------------------------------------

    def _begin(self, pieces: Iterator[_Piece]) -> Iterator[Trace]:
        self.rest()
        self._length = self.rows_played = 0
        self._active = self._traces(pieces)
        return self._active

    def _played(self, blocks: Iterable[ArrayLike]) -> Iterator[_Piece]:
        assert self._loop is not None
        for block in blocks:
            reference = take_reference(block_samples(block, len(self.channels), "reference"))
            command, limited = self._loop.command(reference)
            yield reference, command, limited

    def _driven(self, command_v: FloatArray) -> Iterator[_Piece]:
        soft = max(1, round(SOFT_S * self.rate_hz))
        gain = np.minimum(1.0, np.arange(len(command_v)) / soft)
        wanted = command_v * (0.5 - 0.5 * np.cos(np.pi * gain))[:, None]
        most = np.array([channel.converter.range_v for channel in self.display.channels])
        cut = np.clip(wanted, -most, most)
        yield np.zeros(cut.shape), cut, np.asarray(cut != wanted)

    def _traces(self, pieces: Iterator[_Piece]) -> Iterator[Trace]:
        """Put out the pieces, then what still rings, and yield the trace of every row of the pieces."""
        asked: list[Trace] = []
        late = self._card.latency_samples

        def fed() -> Iterator[Rows]:
            for reference, command, limited in pieces:
                rows, wanted = self._samples(command)
                self._length += len(rows)
                cut, unheard = limited | (wanted != command), np.zeros(wanted.shape)
                asked.append(Trace(self.rate_hz, self.channels, reference, wanted, unheard, cut))
                yield rows
            if self._loop is not None:
                yield self._samples(self._loop.ringing())[0]

        skipped = 0
        try:
            for part in self._run.play(fed(), late, self.allow_gaps):
                before = min(late - skipped, len(part))
                skipped += before
                trace = self._answered(asked, part[before:])
                self._keep_time()
                if len(trace):
                    yield trace
        finally:
            self.gaps += self._rows.gaps
            self._keep_time()

    def _keep_time(self) -> None:
        if self._length:
            self.began_at, self.rows_played = self._rows.begun, min(self._rows.played, self._length)

    def _answered(self, asked: list[Trace], taken: Rows) -> Trace:
        """Take the oldest rows off `asked`, as many as were taken in, (n, inputs), and return them with those."""
        answered = join_traces(take_rows(asked, len(taken)), self.rate_hz, self.channels)
        position_v, saturated = np.zeros(answered.reference.shape), answered.saturated.copy()
        for column, wires in enumerate(self._card.wires):
            if wires.input:
                samples = taken[: len(answered), wires.input - 1].astype(np.float64)
                saturated[:, column] |= np.abs(samples) >= CLIPPED
                position_v[:, column] = wires.input_full_scale_v * samples
        return replace(answered, position_v=position_v, saturated=saturated | (np.abs(position_v) > self.travel_v))

    def _samples(self, command_v: FloatArray) -> tuple[Rows, FloatArray]:
        """Return the card's rows for volts (n, channels), and the volts that they are, within full scale."""
        rows = np.zeros((len(command_v), self._rows.outputs), dtype=np.float32)
        volts = np.empty(command_v.shape)
        for column, wires in enumerate(self._card.wires):
            full = wires.output_full_scale_v
            share = np.clip(command_v[:, column] / full, -1.0, 1.0)
            rows[:, wires.output - 1] = share
            volts[:, column] = np.where(np.abs(share) < 1.0, command_v[:, column], full * share)
        return rows, volts

    def _refuse_clipped(self, trace: Trace) -> None:
        for column, (name, wires) in enumerate(zip(self.channels, self._card.wires, strict=True)):
            count = int(np.sum(np.abs(trace.position_v[:, column]) >= CLIPPED * wires.input_full_scale_v))
            if wires.input and count:
                raise BadInput(
                    f"channel {name!r}: input {wires.input} of the card clips ({count} samples at full scale, "
                    f"{wires.input_full_scale_v:g} V)",
                    "a lower level, or less gain before the input",
                )


class OpenLoop:
    """The channels of a controller whose F gives the command itself. Raises BadInput for a closed loop."""

    def __init__(self, controller: Controller) -> None:
        for part in controller.channels:
            if part.feedback_sos is not None:
                raise BadInput(
                    f"channel {part.name!r}: the controller closes a loop, and a sound card answers tens of "
                    "milliseconds late",
                    'structure = "none" in [feedback]',
                )
        self._rate_hz, self._channels = controller.rate_hz, controller.display.channels
        self._limits_v = [part.limits.command_v for part in controller.channels]
        self._cascades = [
            (part.prefilter_sos / part.prefilter_sos[:, 3:4], *displacement_sections(channel, controller.rate_hz))
            for channel, part in zip(self._channels, controller.channels, strict=True)
        ]
        self._comfort_db_sl = min(COMFORT_DB_SL, *(part.limits.comfort_db_sl for part in controller.channels))
        self._delay_samples = controller.delay_samples
        self.reset()

    def reset(self) -> None:
        """Bring every state to rest."""
        self._held = np.zeros((self._delay_samples, len(self._channels)))
        self._states = [[np.zeros((len(sections), 2)) for sections in cascade] for cascade in self._cascades]

    def command(self, reference: FloatArray) -> tuple[FloatArray, Flags]:
        """Return the volts (n, channels) for a reference (n, channels), threshold units, and where they were cut.

        Raises BadInput for a reference beyond comfort, or beyond a channel's travel by the display's model.
        """
        peak = float(np.max(np.abs(reference), initial=0.0))
        if peak > COMFORT_TOLERANCE * float(from_db(self._comfort_db_sl)):
            raise BadInput(
                f"the reference reaches {float(db(peak)):.1f} dB SL", f"comfort, {self._comfort_db_sl:g} dB SL"
            )
        channels = [self._channel(index, column) for index, column in enumerate(reference.T)]
        volts, limited = (np.column_stack(columns) for columns in zip(*channels, strict=True))
        later = np.concatenate([self._held, volts])
        self._held = later[len(volts) :].copy()
        return later[: len(volts)], limited

    def _channel(self, index: int, reference: FloatArray) -> tuple[FloatArray, Flags]:
        """Return the volts (n,) of one channel and where they were cut. Raises BadInput beyond the travel."""
        channel, cascade, states = self._channels[index], self._cascades[index], self._states[index]
        wanted, states[0] = scipy.signal.sosfilt(cascade[0], reference, zi=states[0])
        volts = moved = np.clip(wanted, -self._limits_v[index], self._limits_v[index])
        for k, sections in enumerate(cascade[1:], start=1):
            moved, states[k] = scipy.signal.sosfilt(sections, moved, zi=states[k])
        reach = float(np.max(np.abs(moved), initial=0.0))
        if reach > COMFORT_TOLERANCE * channel.travel_mm:
            raise BadInput(
                f"channel {channel.name!r}: the reference moves it by {reach:.3g} mm by the display's model",
                f"its travel, {channel.travel_mm:g} mm",
            )
        return volts, volts != wanted

    def ringing(self) -> FloatArray:
        """Return the volts (n, channels) by which the controller dies away from here, faded out at their end."""
        count = round(_RING_S * self._rate_hz)
        volts, _ = self.command(np.zeros((count, len(self._channels))))
        level = np.max(np.abs(volts), axis=1)
        loud = np.flatnonzero(level > float(from_db(_RING_DB)) * max(1e-9, float(np.max(level, initial=0.0))))
        fade = min(count, round(_FADE_S * self._rate_hz))
        end = min(count, int(loud[-1]) + 1 + fade if loud.size else fade)
        line = np.ones(end)
        line[-fade:] = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, fade + 1) / fade)
        return np.asarray(volts[:end] * line[:, None])


def displacement_sections(channel: Channel, rate_hz: float) -> tuple[FloatArray, ...]:
    """Return the sections, cascade after cascade, from volts of command to millimetres at the finger by the channel's
    model: its plant without dead time, integrated as often as the sensor has differentiated.

    A velocity or acceleration sensor does not show slow motion: below half the band's lower edge the integral decays, s
    / (s + w)^2 in place of 1 / s, with 1.25 times its gain so that nothing in the band is underestimated. Raises
    BadInput for a plant that is not stable, whose travel no open loop can hold.
    """
    plant = channel.plant
    if not plant.is_stable:
        raise BadInput(
            f"channel {channel.name!r}: its plant is not stable, and nothing holds its travel without a loop",
            "a stable plant",
        )
    still = ContinuousSystem(plant.zeros, plant.poles, plant.gain / channel.sensor_gain_v_per_mm)
    held = discretise(still, rate_hz, "zoh").sections()
    slowest = 2.0 * np.pi * _SLOWEST * channel.threshold.band_hz[0]
    let_go = ContinuousSystem(np.zeros(1), np.array([-slowest, -slowest]), 1.0 + _SLOWEST**2)
    integral = discretise(let_go, rate_hz, "bilinear").sections()
    cascades = (held, *[integral] * DERIVATIVES[channel.quantity])
    return tuple(np.asarray(sections / sections[:, 3:4]) for sections in cascades)

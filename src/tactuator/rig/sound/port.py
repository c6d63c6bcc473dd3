"""A stream of PortAudio on a card, opened for a display's wiring."""

from __future__ import annotations

from typing import Any, Protocol

from tactuator.errors import BadInput, DeviceFault
from tactuator.rig.sound.cards import Card
from tactuator.rig.sound.library import leave_library, quiet, sounddevice
from tactuator.rig.sound.rows import CardRows, callback_address


class Port(Protocol):
    """The other side of the rows: something that calls back, as a card does."""

    def close(self, alive: bool) -> None:
        """Let go of the card. alive: it still calls back; False: it does not, and is left as it is."""
        ...


class CardPort:
    """A duplex stream between `out` and `taken_from` (None: outputs only) that exchanges `rows`.

    Raises BadInput where the card lacks channels or the rate, and DeviceFault where it cannot be opened.
    """

    def __init__(
        self, out: Card, taken_from: Card | None, outputs: int, inputs: int, rate_hz: float, rows: CardRows
    ) -> None:
        library = sounddevice()
        check_channels(out.outputs, outputs, out, "outputs")
        if taken_from is not None:
            check_channels(taken_from.inputs, inputs, taken_from, "inputs")
        ours = library._ffi
        common: dict[str, Any] = {
            "samplerate": rate_hz,
            "blocksize": 0,
            "dtype": "float32",
            "latency": "high",
            "extra_settings": None,
            "callback": ours.cast("PaStreamCallback*", callback_address()),
            "finished_callback": None,
            "clip_off": True,
            "dither_off": True,
            "never_drop_input": None,
            "prime_output_buffers_using_stream_callback": None,
            "userdata": ours.cast("void*", rows.address),
            "wrap_callback": None,
        }
        kind = "output" if taken_from is None else "duplex"
        device: Any = out.index if taken_from is None else (taken_from.index, out.index)
        channels: Any = outputs if taken_from is None else (inputs, outputs)
        try:
            with quiet():
                self._stream = library._StreamBase(kind, device=device, channels=channels, **common)
                self._stream.start()
        except library.PortAudioError as error:
            raise refusal(error, out, rate_hz) from None
        self._rows = rows  # kept for as long as the card may call back

    @property
    def latency_s(self) -> tuple[float, float]:
        """Return what PortAudio says of the latency of input and output, seconds."""
        told = self._stream.latency
        return (0.0, float(told)) if isinstance(told, float) else (float(told[0]), float(told[1]))

    def close(self, alive: bool) -> None:
        """Let go of the card."""
        if not alive:
            leave_library()
            return
        with quiet():
            self._stream.abort(ignore_errors=True)
            self._stream.close(ignore_errors=True)


def check_channels(there: int, wanted: int, card: Card, what: str) -> None:
    """Raise BadInput where a card has too few outputs or inputs."""
    if there < wanted:
        raise BadInput(f"sound card {card.full_name!r} has {there} {what}; allowed here: {wanted} or more")


def refusal(error: Exception, card: Card, rate_hz: float) -> BadInput | DeviceFault:
    """Return what PortAudio's error says of the card: a rate that it has not, or that it cannot be opened."""
    words = str(error.args[0]) if error.args else str(error)
    if "sample rate" in words.lower():
        return BadInput(f"sound card {card.full_name!r} does not run at {rate_hz:g} Hz; allowed: {card.rate_hz:g} Hz")
    return DeviceFault(f"sound card {card.full_name!r} cannot be opened ({words}); allowed: one that nobody else holds")

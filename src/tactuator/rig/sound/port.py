"""A stream of PortAudio on a card, opened for a display's wiring."""

from __future__ import annotations

from typing import Any, Protocol

from tactuator.errors import BadInput, DeviceFault
from tactuator.rig.sound.cards import Card
from tactuator.rig.sound.library import PORTAUDIO, leave_library, quiet, sounddevice
from tactuator.rig.sound.rows import CardRows, callback_address


class Port(Protocol):
    """The other side of the rows: something that calls back, as a card does."""

    def close(self, alive: bool) -> None:
        """Let go of the card. alive: it still calls back; False: it does not, and is left as it is."""
        ...


class CardPort:
    """A duplex stream between `out` and `taken_from` (None: outputs only) that exchanges `rows`.

    Raises BadInput where the card lacks channels or the rate, and DeviceFault where it cannot be opened or does not
    answer.
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

        def started() -> tuple[Any, CardRows]:
            stream = library._StreamBase(kind, device=device, channels=channels, **common)
            try:
                stream.start()
            except library.PortAudioError:
                _end(stream)
                raise
            return stream, rows  # the rows have to live for as long as the card may call back

        try:
            with quiet():
                self._stream, self._rows = PORTAUDIO.answer(
                    started, f"opening sound card {out.full_name!r}", lambda made: _end(made[0])
                )
        except library.PortAudioError as error:
            raise refusal(error, out, rate_hz) from None

    def close(self, alive: bool) -> None:
        """Let go of the card. Raises DeviceFault where it does not answer."""
        if not alive:
            leave_library()
            return
        with quiet():
            PORTAUDIO.answer(lambda: _end(self._stream), "letting go of the sound card")


def _end(stream: Any) -> None:
    stream.abort(ignore_errors=True)
    stream.close(ignore_errors=True)


def check_channels(there: int, wanted: int, card: Card, what: str) -> None:
    """Raise BadInput where a card has too few outputs or inputs."""
    if there < wanted:
        raise BadInput(f"sound card {card.full_name!r} has {there} {what}; allowed here: {wanted} or more")


def refusal(error: Exception, card: Card, rate_hz: float) -> BadInput | DeviceFault:
    """Return what PortAudio's error says of the card: a rate that it has not, or that it cannot be opened."""
    words = str(error.args[0]) if error.args else str(error)
    words = words.removeprefix("Error opening _StreamBase: ")  # a class that nobody outside knows
    if "sample rate" in words.lower():
        return BadInput(f"sound card {card.full_name!r} does not run at {rate_hz:g} Hz", f"{card.rate_hz:g} Hz")
    return DeviceFault(f"sound card {card.full_name!r} cannot be opened ({words})", "one that nobody else holds")

"""The image: a controller as the bytes that a board loads (layout: core/board/image.h), with what it feeds forward for
a finger (core/touch/feed_forward.h).

Sections are in delta form, as the core computes with them, each sum exact, then rounded to double and to float32:
H = (b0 + b1 z^-1 + b2 z^-2)/(1 + a1 z^-1 + a2 z^-2) = (b0 d^2 + b1' d + b2')/(d^2 + a1' d + a2') with d = z - 1 and
b1' = 2 b0 + b1, b2' = b0 + b1 + b2, a1' = 2 + a1, a2' = 1 + a1 + a2 (Middleton & Goodwin 1990, chapter 2).
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum
from fractions import Fraction
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import ChannelController, Controller, FeedForward, StrengthShaping, pair_turns
from tactuator.runtime._core import ffi, lib
from tactuator.signals.decibels import from_db
from tactuator.signals.discretise import held_matrices
from tactuator.signals.systems import check_sections

CHANNELS_MAX: int = lib.TACT_CHANNELS_MAX
"""Channels that a board runs."""
_HEAD = struct.Struct("<4sHBBIf")
_MAGIC, _VERSION = b"TACI", 4
_CHANNEL_HEAD = struct.Struct("<16sBBBBf")
"""Of a channel in an image: name, prefilter sections, feedback sections, the layout of what feeds forward for a finger
and of what reshapes the reference (0: none), command limit in volts."""


def delta_coefficients(sos: ArrayLike) -> FloatArray:
    """Return b0, b1', b2', a1', a2' of each section in double, sums exact before they are rounded: shape (n, 5)."""
    rows = []
    for section in check_sections(sos).tolist():
        b0, b1, b2, a0, a1, a2 = map(Fraction, section)
        rows.append([float(x / a0) for x in (b0, 2 * b0 + b1, b0 + b1 + b2, 2 * a0 + a1, a0 + a1 + a2)])
    return np.array(rows, dtype=np.float64).reshape(-1, 5)


def delta_coefficients_single(sos: ArrayLike, most: int, name: str) -> NDArray[np.float32]:
    """Return `delta_coefficients` rounded to float32, shape (n, 5).

    Raises BadInput for more than `most` sections, or for a coefficient that float32 cannot hold; `name` says of what.
    """
    exact = delta_coefficients(sos)
    if exact.shape[0] > most:
        raise BadInput(f"{name} has {exact.shape[0]} sections", f"at most {most}")
    if np.any(np.abs(exact) > float(np.finfo(np.float32).max)):
        raise BadInput(f"{name} has a coefficient of {np.max(np.abs(exact)):g}", "what single precision holds")
    return exact.astype(np.float32)


class ImageRefusal(IntEnum):
    """Reasons for which the core refuses an image (tact_image_refusal), each with what was got and what is allowed."""

    got: str
    allowed: str

    def __new__(cls, code: int, got: str = "", allowed: str = "") -> Self:
        """Return the reason of that code."""
        reason = int.__new__(cls, code)
        reason._value_, reason.got, reason.allowed = code, got, allowed
        return reason

    GOOD = 0
    TRUNCATED = 1, "it is truncated, or longer than it says", "a file as `build` wrote it"
    NOT_AN_IMAGE = 2, "it is no image", "a file that `build` wrote"
    VERSION_UNKNOWN = 3, "its version is not known here", f"{_VERSION}, layout {lib.TACT_TOUCH_LAYOUT} of a finger"
    CHECKSUM = 4, "its checksum does not fit its contents", "a file as `build` wrote it"
    RATE = 5, "it is for another rate than the board runs at", "the rate of the safety table"
    DELAY = 6, "it is for another computing delay than the board has", "that of the safety table"
    CHANNELS = 7, "it is for another number of channels than the board has", "as many"
    SECTIONS = 8, "it has no prefilter or too many sections", "1 to 8 for F, at most 4 for C"
    COEFFICIENT = 9, "a coefficient is not a number or out of range", "finite ones"
    UNSTABLE_SECTION = 10, "a section has a pole outside the unit circle", "stable sections"
    LIMIT = 11, "its command limit is out of range", "above 0 and below 31 V"

    def error(self, *where: str) -> BadInput:
        """Return the refusal as an error."""
        return BadInput(self.got, self.allowed, where=where)


@dataclass(frozen=True)
class ImageHeader:
    """Head of an image. controller_hash: SHA-256 (hex) of the controller.json it was built from."""

    rate_hz: float
    delay_samples: int
    channels: int
    controller_hash: str
    crc: int


def build_image(controller: Controller) -> bytes:
    """Return the image of a controller, with the hash of its content in the head.

    Raises BadInput for a delay that boards do not have (0), a coefficient beyond float32, or more channels and sections
    than a board has.
    """
    if not 1 <= controller.delay_samples <= lib.TACT_BOARD_DELAY_MAX:
        raise BadInput(
            f"{controller.delay_samples}", f"1 to {lib.TACT_BOARD_DELAY_MAX} on a board", key="delay_samples"
        )
    if len(controller.channels) > CHANNELS_MAX:
        raise BadInput(f"{len(controller.channels)} channels", f"at most {CHANNELS_MAX} on a board")
    parts = [channel_bytes(channel, controller.rate_hz, place) for place, channel in enumerate(controller.channels)]
    for channel, body in zip(controller.channels, parts, strict=True):
        refusal = check_image(_image_of(bytes(32) + body, 1, 1, 1.0), 1.0, 1, 1)
        if refusal is not ImageRefusal.GOOD:
            raise refusal.error(f"channel {channel.name!r}")
    body = bytes.fromhex(controller.content_hash) + b"".join(parts)
    return _image_of(body, len(controller.channels), controller.delay_samples, controller.rate_hz)


def _image_of(body: bytes, channels: int, delay_samples: int, rate_hz: float) -> bytes:
    size = _HEAD.size + len(body) + 4
    return sealed(_HEAD.pack(_MAGIC, _VERSION, channels, delay_samples, size, rate_hz) + body)


def sealed(content: bytes) -> bytes:
    """Return the content with its CRC-32 behind it."""
    return content + struct.pack("<I", zlib.crc32(content))


def check_image(image: bytes, rate_hz: float, delay_samples: int, channels: int) -> ImageRefusal:
    """Return the core's own verdict on an image for a board with this rate, delay and number of channels."""
    parsed = ffi.new("tact_image *")
    verdict = lib.tact_image_parse(parsed, ffi.from_buffer(image), len(image), rate_hz, delay_samples, channels)
    return ImageRefusal(verdict)


def read_image_header(image: bytes) -> ImageHeader:
    """Return the head of an image, once the core has checked all of it. Raises BadInput, one line, if it is refused."""
    if len(image) < _HEAD.size:
        raise ImageRefusal.TRUNCATED.error("image")
    _, _, channels, delay, _, rate_hz = _HEAD.unpack_from(image)
    refusal = check_image(image, rate_hz, delay, channels)
    if refusal is not ImageRefusal.GOOD:
        raise refusal.error("image")
    if not (0.0 < rate_hz < float("inf") and 1 <= delay <= lib.TACT_BOARD_DELAY_MAX):
        raise BadInput(
            f"image: it is for {rate_hz:g} Hz and a delay of {delay}",
            f"above 0 Hz, a delay of 1 to {lib.TACT_BOARD_DELAY_MAX}",
        )
    (crc,) = struct.unpack_from("<I", image, len(image) - 4)
    return ImageHeader(rate_hz, delay, channels, image[_HEAD.size : _HEAD.size + 32].hex(), crc)


def conditioning(channel: ChannelController) -> float:
    """Return the threshold units of reference that a volt of command is worth: 1/D, D the product of all direct gains
    from r to u'; 0 without feedback, or where D is next to nothing.

    Where u' is cut to u, the reference of which u is the answer is r + (u - u')/D (Hanus, Kinnaert & Henrotte 1987,
    Automatica 23, 729-739): with F and C as that reference would have left them, the loop is as linear as before, and
    what is felt is that reference. The core keeps it within comfort (or r).
    """
    if channel.feedback_sos is None:
        return 0.0
    sections = np.concatenate([channel.prefilter_sos, channel.feedback_sos])
    direct = float(np.prod(sections[:, 0] / sections[:, 3]))
    return 1.0 / direct if abs(direct) > 1e-6 else 0.0  # F hardly reaches u' at once: nothing is conditioned


def channel_bytes(channel: ChannelController, rate_hz: float, place: int) -> bytes:
    """Return the part of an image that describes one channel. place: the channel's, so that the channels learn in turn.

    Raises BadInput, with the channel's name, for what the core has no room for and for numbers beyond float32.
    """
    where = f"controller, channel {channel.name!r}: "
    rows: list[NDArray[np.float32]] = [
        delta_coefficients_single(channel.prefilter_sos, lib.TACT_PREFILTER_MAX, where + "prefilter")
    ]
    if channel.feedback_sos is not None:
        rows.append(delta_coefficients_single(channel.feedback_sos, lib.TACT_FEEDBACK_MAX, where + "feedback"))
    touch = b"" if channel.feed_forward is None else _touch_bytes(channel, channel.feed_forward, rate_hz, place)
    strength = b"" if channel.strength is None else _strength_bytes(channel, channel.strength, rate_hz)
    layouts = lib.TACT_TOUCH_LAYOUT if touch else 0, lib.TACT_STRENGTH_LAYOUT if strength else 0
    feedbacks = 0 if channel.feedback_sos is None else len(channel.feedback_sos)
    name = channel.name.encode()[:16].ljust(16, b"\0")
    head = _CHANNEL_HEAD.pack(name, len(channel.prefilter_sos), feedbacks, *layouts, channel.limits.command_v)
    comfort = from_db(channel.limits.comfort_db_sl)  # the greatest reference that conditioning may come to
    unwinding = np.array([*channel.anti_windup.gains, conditioning(channel), comfort], dtype="<f4")
    return head + unwinding.tobytes() + np.concatenate(rows).astype("<f4").tobytes() + touch + strength


def _strength_bytes(channel: ChannelController, shaping: StrengthShaping, rate_hz: float) -> bytes:
    shape, pairs = (lib.TACT_STRENGTH_LEVELS, lib.TACT_STRENGTH_GAINS), (lib.TACT_STRENGTH_PAIRS,)
    if shaping.gains.shape != shape or shaping.pairs_hz.shape != pairs:
        got = f"gains {shaping.gains.shape}, pairs_hz {shaping.pairs_hz.shape}"
        raise BadInput(got, f"{shape} and {pairs}", where=(f"channel {channel.name!r}", "strength"))
    follow = -np.expm1(-1.0 / (shaping.follow_s * rate_hz))
    turns = pair_turns(shaping.pairs_hz, rate_hz)
    figures = np.concatenate(([follow, shaping.damping], turns, shaping.gains.ravel()))
    return figures.astype("<f4").tobytes()


def _touch_bytes(channel: ChannelController, model: FeedForward, rate_hz: float, place: int) -> bytes:
    where = f"controller, channel {channel.name!r}: touch: "
    if channel.feedback_sos is None:
        raise BadInput(f"{where}there is no feedback", "a controller with a loop")
    if len(model.hum_hz) > lib.TACT_TOUCH_HUM_MAX:
        raise BadInput(f"{where}{len(model.hum_hz)} lines of hum", f"at most {lib.TACT_TOUCH_HUM_MAX}")
    if not 1 <= model.turns <= 255:
        raise BadInput(f"{where}turns is {model.turns}", "1 to 255")
    period_s, turn_s = 1.0 / rate_hz, model.turns * (1.0 / rate_hz)
    angles = 2.0 * np.pi * np.array(model.hum_hz, dtype=np.float64) * model.turns / rate_hz
    # the level beside the memory follows so many times sooner, and may not overtake
    forgetting_max = 0.999 / lib.TACT_TOUCH_LEVEL_RATE
    figures = np.concatenate(
        [
            *_poles(model, period_s),
            [
                2.0 * np.pi * model.slow_hz * turn_s,
                min(turn_s / model.forgetting_s, forgetting_max),
                model.gate_v**2,
                model.ridge_v**2,
                model.shape,
                turn_s / model.fading_s,
                turn_s / model.slew_s,
                model.weight_max,
                model.push_max_v,
                4.0 * np.pi * model.hum_band_hz * turn_s,
            ],
            np.stack([np.cos(angles), np.sin(angles)], axis=1).ravel(),
        ]
    )
    if not np.all(np.abs(figures) <= float(np.finfo(np.float32).max)):
        raise BadInput(f"{where}a figure is beyond single precision", "what it holds")
    counts = bytes([model.delay_samples, model.turns, place % model.turns, len(model.hum_hz)])
    return counts + figures.astype("<f4").tobytes()


def _pushes(model: FeedForward, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return what the designed finger's two pushes are, volts for a volt of command, of change in a sample, of place.

    The place is taken half a sample on, in the middle of a change.
    """
    mass, damping, stiffness = model.load
    drag, spring = model.damping / model.gain / period_s, model.stiffness / model.gain
    rest = np.array([damping / model.gain / period_s + 0.5 * stiffness / model.gain, stiffness / model.gain])
    return mass * np.array([1.0, drag + 0.5 * spring, spring]), rest


def _poles(model: FeedForward, period_s: float) -> list[FloatArray]:
    """Return how the three poles G = c/(d + c), d = z - 1, are fed and summed, in the order of tact_touch.

    Of the held plant B/A with B = b1 d + b, the balance is G^3 (B u - A y)/b. Since d G = c (1 - G), B G^3 and A G^3
    are sums of G, G^2 and G^3: u and y are fed into the third, second and first pole with these shares. The model's
    position yd passes G^3; the pushes are sums of its c^2 (1 - G)^2 G, c (1 - G) G^2 and G^3, since A yd = B ud.
    """
    b1, b, a1, a2 = held_second_order(model, period_s)
    corner = 2.0 * np.pi * model.corner_hz * period_s
    lead = corner * b1 / b
    inverse = np.array([corner * corner, corner * a1, a2]) / b
    inverted = np.array([inverse[0], inverse[1] - 2.0 * inverse[0], inverse[0] - inverse[1] + inverse[2]])
    change = np.array([lead, 1.0, 0.0]) * corner
    place = np.array([0.0, lead, 1.0])
    mass, rest = _pushes(model, period_s)
    return [
        np.array([b1, b, a1, a2]),
        np.array([corner]),
        corner * np.array([lead, 1.0 - lead]),
        corner * inverted,
        model.mass_fed * mass,
        rest,
        mass[0] * inverse - mass[1] * change - mass[2] * place,
        rest[0] * change + rest[1] * place,
    ]


def held_second_order(model: FeedForward, period_s: float) -> FloatArray:
    """Return b1, b1 + b0, a1', a2' of the held plant (b1 z + b0)/(d^2 + a1' d + a2') with d = z - 1, shape (4,)."""
    a, b = np.array([[0.0, 1.0], [-model.stiffness, -model.damping]]), np.array([0.0, model.gain])
    held, b = held_matrices(a, b, period_s)
    m = held - np.eye(2)
    return np.array([b[0], m[0, 1] * b[1] - m[1, 1] * b[0], -np.trace(m), np.linalg.det(m)])

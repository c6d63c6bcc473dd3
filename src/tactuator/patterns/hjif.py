"""HJIF (MPEG haptics, ISO/IEC 23090-31) as far as AHAP maps to it: transients and vectorial waves of vibration.

The rules are those that MPEG's reference software holds a file to (`IOJson`); other bands and other senses are passed
over, and told. Times are ticks of the file's timescale, frequencies hertz.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from tactuator.errors import BadInput
from tactuator.io.text import parse_finite_json
from tactuator.patterns.clip import LONGEST_S, Breakpoints, Clip, Tap, Tone, number_of, part_of, rows_of, whole_of

TRANSIENT_S = 0.022
"""Length of a transient in the reference software: two periods, whatever its frequency is said to be."""
_BANDS = ("Transient", "Curve", "VectorialWave", "WaveletWave")
_CURVES = ("Unknown", "Cubic", "Linear", "Akima", "Bezier", "Bspline")
_SENSES = (
    "Other", "Pressure", "Acceleration", "Velocity", "Position", "Temperature", "Vibration", "Vibrotactile", "Water",
    "Wind", "Kinesthetic", "Force", "Vibrotactile Texture", "Texture", "Stiffness", "Friction", "Electrotactile",
)  # fmt: skip
_VIBRATION = ("Vibration", "Vibrotactile")
_SIGNALS = ("Sine", "Square", "Triangle", "SawToothUp", "SawToothDown")
_MOST_BANDS, _MOST_CHANNELS = {1: 7, 2: 63}, {1: 127, 2: 65535}
_MOST_HZ, _MOST_TICKS = 10_000, 1 << 31


def parse_hjif(text: str) -> Clip:
    """Return the clip of an HJIF. Raises BadInput, with the reason alone, for what breaks a rule, and for a file in
    which nothing is of the parts that are read.
    """
    document = parse_finite_json(text)
    reader = _Reader(document)
    for k, perception in enumerate(rows_of(part_of(document, "perceptions"), "perceptions")):
        reader.take_perception(perception, f"perceptions[{k}]")
    if not reader.tones and not reader.taps:
        passed = ", ".join(dict.fromkeys(reader.unrendered)) or "no effect"
        raise BadInput(passed, "transients or vectorial waves of vibration", where=("perceptions",))
    end_s = max([*(tone.end_s for tone in reader.tones), *(tap.time_s for tap in reader.taps)])
    return Clip(
        "", "hjif", end_s, tuple(reader.tones), tuple(reader.taps), pitch_in_hz=True, clamped=reader.clamped,
        unrendered=tuple(dict.fromkeys(reader.unrendered)),
    )  # fmt: skip


def _text(table: Mapping[str, Any], key: str, allowed: tuple[str, ...], *where: str) -> str:
    """Return a text of a table, one of those that are allowed (none: any)."""
    value = table.get(key)
    if not isinstance(value, str) or (allowed and value not in allowed):
        got = "missing" if value is None else repr(value)[:60]
        raise BadInput(got, ", ".join(allowed) or "a text", where=where, key=key)
    return value


def _check_unique(tables: list[Mapping[str, Any]], where: str) -> set[int]:
    """Return the ids of tables. Raises BadInput where two have the same."""
    ids = [whole_of(each, "id", -_MOST_TICKS, _MOST_TICKS, f"{where}[{k}]") for k, each in enumerate(tables)]
    twice = [each for each, times in Counter(ids).items() if times > 1]
    if twice:
        raise BadInput(f"{twice[0]} twice", "each id once", where=(where,), key="id")
    return set(ids)


class _Reader:
    """What was read of a file so far, and what holds for all of it."""

    def __init__(self, document: Any) -> None:
        self.tones: list[Tone] = []
        self.taps: list[Tap] = []
        self.unrendered: list[str] = []
        self.clamped = 0
        version = re.fullmatch(r"(\d{4})(?:-(\d))?", str(part_of(document, "version")))
        if version is None or int(version[1]) < 2023 or version[2] == "0":
            allowed = "a year from 2023 on, and after a - the number of an amendment"
            raise BadInput(repr(document["version"])[:60], allowed, key="version")
        self.profile = _text(document, "profile", ("Main", "Simple Parametric"))
        self.level = whole_of(document, "level", 1, 2)
        if not re.search(r"\d{4}", _text(document, "date", ())):
            raise BadInput(repr(document["date"])[:60], "a date as ISO 8601 writes it", key="date")
        _text(document, "description", ())
        simple = self.profile == "Simple Parametric"
        self.ticks_per_s = whole_of(document, "timescale", 1000 if simple else 1, 1000 if simple else 48_000)
        self.avatars = {0, *_check_unique(rows_of(part_of(document, "avatars"), "avatars"), "avatars")}
        if any(each.get("id") == 0 for each in document["avatars"]):
            raise BadInput("0, which stands for none", "another id", where=("avatars",), key="id")
        rows_of(part_of(document, "syncs"), "syncs")
        _check_unique(rows_of(part_of(document, "perceptions"), "perceptions"), "perceptions")

    def take_perception(self, perception: Mapping[str, Any], where: str) -> None:
        """Take the channels of a perception in. Raises BadInput for what breaks a rule."""
        sense = _text(perception, "perception_modality", _SENSES, where)
        _text(perception, "description", (), where)
        if whole_of(perception, "avatar_id", -_MOST_TICKS, _MOST_TICKS, where) not in self.avatars:
            raise BadInput(f"{perception['avatar_id']}", "0, or the id of an avatar", where=(where,), key="avatar_id")
        places = {key: f"{where}.{key}" for key in ("reference_devices", "effect_library", "channels")}
        devices = rows_of(perception.get("reference_devices", []), places["reference_devices"])
        known = _check_unique(devices, places["reference_devices"])
        for k, device in enumerate(devices):
            _check_device(device, f"{places['reference_devices']}[{k}]")
        library = rows_of(part_of(perception, "effect_library"), places["effect_library"])
        _check_unique(library, places["effect_library"])
        named = {each["id"]: each for each in library}
        channels = rows_of(part_of(perception, "channels"), places["channels"])
        _check_unique(channels, places["channels"])
        if len(channels) > _MOST_CHANNELS[self.level]:
            raise BadInput(f"{len(channels)} channels", f"{_MOST_CHANNELS[self.level]} on this level", where=(where,))
        unit = 10.0 ** number_of(perception, "perception_unit_exponent", -20.0, 20.0, where, missing=0.0)
        for k, channel in enumerate(channels):
            place = f"{places['channels']}[{k}]"
            key = "reference_device_id"
            if key in channel and whole_of(channel, key, -_MOST_TICKS, _MOST_TICKS, place) not in known:
                raise BadInput(f"{channel[key]}", "the id of a reference device", where=(place,), key=key)
            gain = unit * number_of(channel, "gain", 0.0, 1e6, place)
            bands = rows_of(part_of(channel, "bands"), place)
            if len(bands) > _MOST_BANDS[self.level]:
                raise BadInput(f"{len(bands)} bands", f"{_MOST_BANDS[self.level]} on this level", where=(place,))
            for number, band in enumerate(bands):
                self._take_band(band, named, gain if sense in _VIBRATION else 0.0, f"{place}.bands[{number}]")
        if sense not in _VIBRATION:
            self.unrendered.append(sense)

    def _take_band(self, band: Mapping[str, Any], library: Mapping[Any, Any], gain: float, where: str) -> None:
        """Take the effects of a band in; a gain of 0 has them checked alone."""
        kind = _text(band, "band_type", _BANDS, where)
        low, high = (whole_of(band, f"{end}_frequency_limit", 0, _MOST_HZ, where) for end in ("lower", "upper"))
        if high < low:
            raise BadInput(f"{high}", f"{low} or more", where=(where,), key="upper_frequency_limit")
        if "curve_type" in band and kind != "Curve":
            raise BadInput(f"there in a {kind} band", "a Curve band", where=(where,), key="curve_type")
        if "curve_type" in band:
            _text(band, "curve_type", _CURVES, where)
        if kind == "WaveletWave":
            length = whole_of(band, "block_length", 1, _MOST_TICKS, where)
            if length & (length - 1):
                raise BadInput(f"{length}", "a power of two", where=(where,), key="block_length")
            if self.profile == "Simple Parametric":
                raise BadInput("a WaveletWave band", "bands of the profile Simple Parametric", where=(where,))
        if kind in ("Curve", "WaveletWave") and gain > 0.0:
            self.unrendered.append(f"{kind} band")
        for k, effect in enumerate(rows_of(part_of(band, "effects"), where)):
            self._take_effect(effect, library, kind, (low, high), gain, f"{where}.effects[{k}]")

    def _take_effect(
        self, effect: Mapping[str, Any], library: Mapping[Any, Any], kind: str, limits: tuple[int, int], gain: float,
        where: str,
    ) -> None:  # fmt: skip
        types = ("Reference", "Basis") if self.profile == "Simple Parametric" else ("Reference", "Basis", "Composite")
        named, position = _text(effect, "effect_type", types, where), effect.get("position")
        at_s = whole_of(effect, "position", -_MOST_TICKS, _MOST_TICKS, where) / self.ticks_per_s
        if named == "Reference":
            if isinstance(effect.get("id"), list | dict) or effect.get("id") not in library:
                raise BadInput(repr(effect.get("id"))[:60], "an effect of the library", where=(where,), key="id")
            effect = {**library[effect["id"]], "position": position}
        if named == "Composite" and gain > 0.0:
            self.unrendered.append("Composite effect")
        frames = rows_of(effect.get("keyframes", []), where, "keyframes")
        if kind == "WaveletWave" and frames:
            raise BadInput("there in a WaveletWave band", "no keyframes", where=(where,), key="keyframes")
        if "base_signal" in effect and _text(effect, "base_signal", _SIGNALS, where) != "Sine" and gain > 0.0:
            self.unrendered.append(f"base signal {effect['base_signal']}, taken for Sine")
        times, amplitudes, frequencies = [], [], []
        for k, frame in enumerate(frames):
            place = f"{where}.keyframes[{k}]"
            ticks = whole_of(frame, "relative_position", 0, _MOST_TICKS, place) if "relative_position" in frame else 0
            times.append(ticks / self.ticks_per_s)
            if "amplitude_modulation" in frame:
                amplitudes.append((times[-1], abs(number_of(frame, "amplitude_modulation", -1.0, 1.0, place))))
            if "frequency_modulation" in frame:
                frequencies.append((times[-1], whole_of(frame, "frequency_modulation", 0, _MOST_HZ, place)))
        if gain == 0.0 or named == "Composite" or kind not in ("Transient", "VectorialWave") or not frames:
            return
        if at_s < 0.0 or at_s + max(times) > LONGEST_S:
            raise BadInput(f"{at_s:g} to {at_s + max(times):g} s", f"within 0 to {LONGEST_S:g} s", where=(where,))
        if kind == "Transient":
            self.taps += [Tap(at_s + time_s, self._clamped(gain * strength), 0.5) for time_s, strength in amplitudes]
        elif max(times) > 0.0:
            self._take_wave(at_s, at_s + max(times), amplitudes, frequencies, limits, gain)

    def _take_wave(
        self, start_s: float, end_s: float, amplitudes: list[tuple[float, float]],
        frequencies: list[tuple[float, int]], limits: tuple[int, int], gain: float,
    ) -> None:  # fmt: skip
        """Take a vectorial wave in: amplitude and frequency go straight from keyframe to keyframe that has them."""
        if not frequencies or max(hertz for _, hertz in frequencies) == 0:
            self.unrendered.append("vectorial wave without a frequency")
            return
        strength = [(start_s + at, self._clamped(gain * value)) for at, value in amplitudes or [(0.0, 1.0)]]
        pitch = [
            (start_s + at, float(np.clip(hertz, max(limits[0], 1), max(limits[1], 1)))) for at, hertz in frequencies
        ]
        self.tones.append(Tone(start_s, end_s, _points(strength), _points(pitch)))

    def _clamped(self, strength: float) -> float:
        self.clamped += strength > 1.0
        return min(strength, 1.0)


def _points(pairs: list[tuple[float, float]]) -> Breakpoints:
    return Breakpoints(*(np.array(column) for column in zip(*sorted(pairs, key=lambda pair: pair[0]), strict=True)))


def _check_device(device: Mapping[str, Any], where: str) -> None:
    _text(device, "name", (), where)
    keys = [key for key in ("minimum_frequency", "resonance_frequency", "maximum_frequency") if key in device]
    values = [number_of(device, key, 0.0, 1e6, where) for key in keys]
    if values != sorted(values):
        raise BadInput(f"{values[-1]:g}", f"{max(values):g} or more", where=(where,), key=keys[-1])

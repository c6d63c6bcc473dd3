"""The safety table of a display: limits, plant and weighting that a board's guard is commissioned with.

It is made once, from the display alone: no controller and no image has a say in it. What the figures are for, and why
they are what they are: docs/safety.md.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.description import Channel, Display
from tactuator.runtime.safety_table import (
    NEVER,
    NEVER_TICKS,
    ChannelSafety,
    Jump,
    SafetyTable,
    Standstill,
    StateObserver,
)
from tactuator.signals.decibels import from_db
from tactuator.signals.discretise import discretise
from tactuator.synthesis.prefilter import weighting_sections

LATENESS_MAX = 0.25
"""Share of a period by which an interrupt may be late (docs/safety.md)."""
SILENCE_S = 0.2
"""Time without a word from the host until it counts as gone."""
SOFT_START_S, FADE_S, RAMP_S, QUICK_S = 0.1, 0.05, 0.05, 0.04
"""Two ramps in, one of the reference and one of the command out; the quick one ends what is too loud."""
COMFORT_TOLERANCE_DB = 1.0
"""Above comfort, where the guard ends a run (docs/safety.md)."""
LIFTED_DB = 0.7
"""Below comfort, for the reference: 0.5 dB for a finger that is taken off at the worst moment, and 0.2 dB so that one
that presses meanwhile does not bring the loudest reference to the limit of the travel (docs/safety.md)."""
ADAPTIVE_DB = 3.0
"""Below that, where a finger is fed forward: what weights that are still a finger's add when it is lifted."""
OBSERVER_RAD_S = 125.0
"""Poles of the guard's observer: 20 Hz, so that it follows a finger that presses."""
FROZEN_S, FROZEN_MOST_S, FROZEN_CHANCE = 0.0125, 0.05, 1e-12
"""Seconds of one code that are a frozen sensor, at least and at most; chance of it by noise."""
STOP_SHARE, OPEN_SHARE, DISAGREEMENT_SHARE = 0.85, 1.15, 0.14
"""Of the travel: where the motor would come to rest, what no reading reaches, how far off the model may be (a finger's
force of 1.9 V: docs/safety.md)."""
REVERSAL_NOISES = 400.0
"""A finger that presses moves the sensor against the motor, too: at 8 a tenth of a volt's worth of it was taken for a
reversed sensor."""
STILL_CODES, STRAY_SHARE = 6, 0.12
"""A sensor that is stuck within three codes of noise is reported once the command should have moved the motor by 12 %
of its travel: five times what presses of a finger bring about (docs/safety.md). Within eight codes, a sound sensor
stood still for 0.2 s under a finger that let go slowly."""
STILL_HUM_CODES = 3.0
"""Least hum, at its peak: a quieter sensor may read one code while the loop holds a finger, and is not judged."""
JUMP_FORCE_V, JUMP_NOISES, JUMP_SHARE = 1.0, 12.0, 0.1
"""A finger's force that sets in at once, in volts of command; the sensor's noise (rms); the model's own error. Lawful
play came to two thirds of what is allowed (docs/safety.md)."""
TRAVEL_HZ, TRAVEL_SHARE = 8.0, 0.55
"""A sinusoid within the reference's limit takes no more of the travel; above some 9 Hz comfort is the lower limit."""
TRAVEL_NEVER = 1e5
"""Threshold units: no slow part is limited."""
LOCK_S, LOCK_FAULTS = 1.0, 3
"""A sensor or travel fault is cleared after a second; after three of them a person has to look."""
_NOWHERE = StateObserver(0.0, 0.0, 0.0, 0.0, 0.0)


def safety_table(display: Display) -> SafetyTable:
    """Return the safety table of `display`.

    A plant that is no second-order motor measured by its displacement has neither stopping distance nor observer:
    comfort, command, range, frozen sensor, lateness and silence are watched all the same.
    """
    rate = display.rate_hz
    channels = tuple(_channel(display, channel) for channel in display.channels)
    ticks = (round(duration * rate) for duration in (SILENCE_S, SOFT_START_S, FADE_S, RAMP_S, QUICK_S))
    silence, soft_start, fade, ramp, quick = ticks
    return SafetyTable(
        rate, display.delay_samples, LATENESS_MAX, silence, soft_start, fade, ramp, quick, turns(display),
        travel_share(rate), round(LOCK_S * rate), LOCK_FAULTS, channels,
    )  # fmt: skip


def soft_ticks(rate_hz: float) -> int:
    """Return the ticks until a run's soft start is surely over: two ramps, each up to a tick longer."""
    return round(SOFT_START_S * rate_hz) + 4


def turns(display: Display) -> int:
    """Return the number of ticks from one look at a channel's comfort to the next: one channel a tick where the rate
    leaves that four times the band's end.
    """
    highest_hz = max(channel.threshold.band_hz[1] for channel in display.channels)
    return max(1, min(len(display.channels), int(display.rate_hz / (4.0 * highest_hz))))


def travel_share(rate_hz: float) -> float:
    """Return the share of the reference that goes into its slow part in a tick: a first-order low pass at TRAVEL_HZ."""
    return -math.expm1(-2.0 * math.pi * TRAVEL_HZ / rate_hz)


def travel_max(channel: Channel, reference_max: float) -> float:
    """Return the most that the reference's slow part may come to, in threshold units, so that no sinusoid within the
    limits takes more than TRAVEL_SHARE of the channel's travel; TRAVEL_NEVER where comfort sees to that.
    """
    frequency_hz = _band(channel)
    displacement_mm = channel.prefilter_voltage(frequency_hz) / channel.sensor_gain_v_per_mm
    allowed = TRAVEL_SHARE * channel.travel_mm / displacement_mm
    limited = allowed < reference_max
    slow = allowed / np.hypot(1.0, frequency_hz / TRAVEL_HZ)
    return float(np.min(slow[limited], initial=TRAVEL_NEVER))


def _band(channel: Channel) -> FloatArray:
    return np.geomspace(*channel.threshold.band_hz, 400)


def standstill(channel: Channel) -> Standstill:
    """Return the limits for a stuck sensor; NEVER for one so quiet that a sound one reads a constant code. They are not
    reached without a model of the plant.
    """
    hum_codes = sum(channel.environment.hum_v_peak) / channel.converter.step_v
    stray_max_v = STRAY_SHARE * channel.travel_mm * channel.sensor_gain_v_per_mm
    return Standstill(STILL_CODES, stray_max_v if hum_codes >= STILL_HUM_CODES else NEVER)


def jump(channel: Channel, rate_hz: float, turns: int) -> Jump:
    """Return the limits for a sensor that jumps, compared every `turns` ticks.

    A force of JUMP_FORCE_V changes the motion of two turns by the plant's drive alone; a load changes the drive by its
    mass, as a share of the motion that the model expects.
    """
    model, _ = observer(channel, rate_hz)
    forced_v = 4.0 * abs(model.drive) * turns**2 * JUMP_FORCE_V
    loaded = [replace(channel, plant=channel.loaded_plant(load)) for load in channel.loads]
    drives = [abs(observer(each, rate_hz)[0].drive / model.drive - 1.0) for each in loaded]
    return Jump(forced_v + JUMP_NOISES * channel.environment.noise_v_rms, JUMP_SHARE + max(drives, default=0.0))


def is_watched(channel: Channel) -> bool:
    """Return whether the guard has a model of this channel's plant: two poles, no zeros, displacement."""
    return channel.quantity == "displacement" and channel.plant.poles.size == 2 and channel.plant.zeros.size == 0


def observer(channel: Channel, rate_hz: float) -> tuple[StateObserver, float]:
    """Return the plant's model and its correction (both poles at exp(-OBSERVER_RAD_S / rate)), and the damping that is
    left to a motor without command: share of the velocity lost in a tick.

    In d = z - 1 the plant's denominator is d^2 + a1 d + a2: spring = a2, damp = a1 - a2; the drive acts on the mean of
    two inputs, which puts the zero of the held plant at -1 (it lies at -0.99).
    """
    sampled = discretise(channel.plant, rate_hz, "zoh")
    differences = 1.0 - sampled.poles
    spring = float(np.real(np.prod(differences)))
    damp = float(np.real(np.sum(differences))) - spring
    drive = float(np.real(sampled.gain * np.prod(1.0 - sampled.zeros)))
    pole = math.exp(-OBSERVER_RAD_S / rate_hz)
    both = 2.0 - spring - damp - 2.0 * pole
    correct_w = pole**2 / (1.0 - damp) - 1.0 + both
    lost = -math.expm1(-_brakes_rad_s(channel.plant.poles.real) / rate_hz)
    return StateObserver(0.5 * drive, damp, spring, both - correct_w, correct_w), lost


def _brakes_rad_s(poles: FloatArray) -> float:
    """Return the damping of a motor without command. One that runs away (a pole at a > 0, one at -b) does not come to
    rest: x + x'/b is what grows then. Where nothing brakes, what the observer follows is taken.
    """
    brakes = -float(np.min(poles) if np.max(poles) > 0.0 else np.sum(poles))
    return brakes if brakes > 0.0 else OBSERVER_RAD_S


def frozen_ticks(channel: Channel, rate_hz: float) -> int:
    """Return the number of ticks that the same reading may last: chance 1e-12 that the sensor's own noise stays within
    one step. NEVER_TICKS for a sensor that is so quiet that it rests on one code.
    """
    noise_steps = channel.environment.noise_v_rms / channel.converter.step_v
    stays = math.erf(0.5 / (math.sqrt(2.0) * noise_steps)) if noise_steps > 0.05 else 1.0
    if stays >= 1.0:
        return NEVER_TICKS
    needed = max(FROZEN_S * rate_hz, math.log(FROZEN_CHANCE) / math.log(stays))
    return math.ceil(needed) if needed <= FROZEN_MOST_S * rate_hz else NEVER_TICKS


def reversal_power(channel: Channel, rate_hz: float) -> float:
    """Return the mean square of motion, in V^2 between two looks at a rate of rate_hz, from which its sign can be
    determined: REVERSAL_NOISES times what the noise of two readings' difference leaves in the guard's mean over some 40
    of them.
    """
    environment, step_v = channel.environment, channel.converter.step_v
    hum = sum(
        0.5 * (level_v * 2.0 * math.pi * frequency_hz / rate_hz) ** 2
        for frequency_hz, level_v in zip(environment.hum_hz, environment.hum_v_peak, strict=True)
    )
    difference = 2.0 * environment.noise_v_rms**2 + step_v**2 / 6.0 + hum
    return REVERSAL_NOISES**2 * difference * 0.0125


def _channel(display: Display, channel: Channel) -> ChannelSafety:
    rate = display.rate_hz
    converter, travel_v = channel.converter, channel.travel_mm * channel.sensor_gain_v_per_mm
    code_max = 2 ** (converter.bits - 1) - 1
    comfort = float(from_db(display.objectives.comfort_db_sl))
    watched = is_watched(channel)
    raised = channel.prefilter_voltage(_band(channel)) / channel.threshold_voltage(_band(channel))
    lifted = from_db(LIFTED_DB + ADAPTIVE_DB * display.touch.adaptive) * max(1.0, float(np.max(raised)))
    reference_max = comfort / float(lifted)
    model, lost = observer(channel, rate) if watched else (_NOWHERE, 1.0)
    return ChannelSafety(
        converter=converter,
        position_code_max=min(code_max - 1, round(OPEN_SHARE * travel_v / converter.step_v))
        if watched
        else code_max - 1,
        frozen_ticks=frozen_ticks(channel, rate),
        stop_max_v=STOP_SHARE * travel_v if watched else code_max * converter.step_v,
        stop_lead=1.0 / lost if watched else 0.0,
        command_max_v=converter.range_v,
        reference_max=reference_max,
        comfort_max=comfort * float(from_db(COMFORT_TOLERANCE_DB)),
        disagreement_v=DISAGREEMENT_SHARE * travel_v if watched else NEVER,
        reversal_power=reversal_power(channel, rate / turns(display)) if watched else NEVER,
        observer=model,
        standstill=standstill(channel),
        jump=jump(channel, rate, turns(display)) if watched else Jump(NEVER, 0.0),
        travel_max=travel_max(channel, reference_max),
        weighting_sos=weighting_sections(channel, rate / turns(display)),
    )

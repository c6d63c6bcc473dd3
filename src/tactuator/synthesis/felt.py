"""The felt levels of a channel at rest, by its model: hum, noise and converter steps through the loop, and friction.

Sensor noise and hum n reach the fingertip as -T n, a disturbance of the command as P S d; never the sensor's own
spectrum. Small motions stay within the distance over which friction builds up, where Dahl's friction is a spring and
a damper beside the plant: P/(1 + P k) in place of P.

Dahl friction of Coulomb level F (volts of command) that builds up over the distance x0 (volts of sensor) describes,
between -Y and Y, the branches

    f(x) = F - (F + f_m) exp(-(x + Y)/x0) going up, its mirror image going down, f_m = F tanh(Y/x0).

Its first harmonic D(Y), against a motion of amplitude Y and phase zero, enters the loop as a disturbance of the
command: H r = Y + P S D.

A converter of step q that rests m steps from a code passes a sinusoid of amplitude A, beside noise of rms s and lines
of amplitudes B, with the gain

    N = 1 + 2 sum_k (-1)^k [2 J1(2 pi k A/q)/(2 pi k A/q)] exp(-2 (pi k s/q)^2) prod J0(2 pi k B/q) cos(2 pi k m),

the first harmonic of its saw of an error (Gelb & Vander Velde 1968, "Multiple-Input Describing Functions").
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.description import Channel, Environment
from tactuator.signals.decibels import db, from_db
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.signals.loop_figures import margins
from tactuator.synthesis.assessment import command_noise_gain

_ANGLES = (np.arange(256) + 0.5) * (np.pi / 256.0)
"""Of half a period, radians, at the middle of each step: a mean over them is an integral."""
_RESTS = np.linspace(0.0, 0.5, 9)
"""Where converters may rest, in steps from a code."""


def dahl_harmonic(amplitude_v: FloatArray, friction_v: float, presliding_v: float) -> NDArray[np.complex128]:
    """Return the first harmonic of the friction (volts of command, complex, against x = Y cos) for amplitudes (n,) in
    volts.
    """
    size = np.maximum(np.asarray(amplitude_v, dtype=np.float64)[:, None], 1e-12 * presliding_v)
    reached = friction_v * np.tanh(size / presliding_v)
    # going down from +Y: x = Y cos(angle), angle 0..pi; the way up is its mirror image
    way = size * (1.0 - np.cos(_ANGLES))
    force = -friction_v + (friction_v + reached) * np.exp(-way / presliding_v)
    return np.asarray(2.0 * np.mean(force * np.exp(-1j * _ANGLES), axis=1))


_ROUNDS = 8
"""Rounds in which hum and the friction along its motion, each depending on the other, settle."""


def felt_db_sl(channel: Channel, peak_volts: FloatArray, frequency_hz: FloatArray) -> FloatArray:
    """Return the level, dB SL, of a motion that is `peak_volts` at an ideal sensor, at `frequency_hz`; shapes alike."""
    return db(peak_volts / channel.threshold_voltage(frequency_hz))


def beside_friction(environment: Environment, plant: ComplexArray, amplitude_v: FloatArray) -> ComplexArray:
    """Return the response P/(1 + P k) of a plant whose motion has the amplitude `amplitude_v` (volts of y, (n,)), with
    friction beside it; `plant`: its response without friction, (n,)."""
    if environment.friction_v == 0.0:
        return plant
    harmonic = dahl_harmonic(amplitude_v, environment.friction_v, environment.presliding_v)
    size = np.maximum(amplitude_v, 1e-12 * environment.presliding_v)
    return np.asarray(plant / (1.0 + plant * harmonic / size))


def felt_hum_v(channel: Channel, loop: TwoDegreeLoop) -> FloatArray:
    """Return the fingertip's motion at every line of the channel's hum, peak volts at an ideal sensor, (lines,)."""
    lines, hum = np.array(channel.environment.hum_hz), np.array(channel.environment.hum_v_peak)
    if loop.feedback is None or lines.size == 0:
        return np.zeros(lines.size)
    controller, plant = loop.feedback.controller.response(lines), loop.feedback.plant.response(lines)
    moved = np.abs(loop.feedback.complementary(lines)) * hum
    for _ in range(_ROUNDS):
        through = controller * beside_friction(channel.environment, plant, moved)
        moved = np.abs(through / (1.0 + through)) * hum
    return np.asarray(moved)


def felt_noise_rms_v(channel: Channel, loop: TwoDegreeLoop, rate_hz: float, edges_hz: FloatArray) -> FloatArray:
    """Return the rms of the finger's motion (volts at an ideal sensor) in bands of edges (n, 2): sensor noise and the
    A/D's steps through T, the D/A's steps through P S. Steps make white noise of step^2 / 12."""
    step = channel.converter.step_v**2 / 12.0
    nodes, weights = np.polynomial.legendre.leggauss(12)
    half = 0.5 * np.diff(edges_hz, axis=1)
    frequency = edges_hz[:, :1] + half * (1.0 + nodes)
    if loop.feedback is None:
        power = np.abs(loop.plant.response(frequency)) ** 2 * step
    else:
        sensed = channel.environment.noise_v_rms**2 + step
        power = np.abs(loop.feedback.complementary(frequency)) ** 2 * sensed
        power = power + np.abs(loop.feedback.load_sensitivity(frequency)) ** 2 * step
    return np.asarray(np.sqrt(np.sum(power * half * weights, axis=1) / (0.5 * rate_hz)))


def friction_loss_db(
    channel: Channel, loop: TwoDegreeLoop, frequency_hz: FloatArray, level_db_sl: float | FloatArray, rounds: int = 1
) -> FloatArray:
    """Return the loss, dB, shape (n,), by which a sinusoid of `level_db_sl` (one for all, or (n,)) at `frequency_hz`
    moves less than its reference.

    From the friction that the display file states; negative where the spring of presliding adds to the motion. rounds:
    the first takes the friction of the motion that is asked for, each further one that of the motion before.
    """
    asked = channel.threshold_voltage(frequency_hz) * from_db(level_db_sl)
    environment = channel.environment
    path = loop.plant.response(frequency_hz) if loop.feedback is None else loop.feedback.load_sensitivity(frequency_hz)
    loss = np.zeros(asked.shape)
    for _ in range(rounds):
        position = asked / from_db(loss)
        loss = db(1.0 + path * dahl_harmonic(position, environment.friction_v, environment.presliding_v) / position)
    return loss


def step_gain(
    step_v: float, amplitude_v: FloatArray, noise_v_rms: float, lines_v: FloatArray, rests: FloatArray = _RESTS
) -> FloatArray:
    """Return the gain of a converter for sinusoids of amplitudes (n,) beside noise and lines (peak volts), (rests, n),
    for each place where it rests, in steps from a code."""
    k = np.arange(1, 17)
    phase = 2.0 * np.pi * k[:, None] * np.maximum(amplitude_v, 1e-9 * step_v) / step_v
    share = 2.0 * scipy.special.j1(phase) / phase
    # the least noise of a converter's own edge is a twentieth of its step
    share = share * np.exp(-2.0 * (np.pi * k * max(noise_v_rms / step_v, 0.05)) ** 2)[:, None]
    share = share * np.prod(scipy.special.j0(2.0 * np.pi * np.outer(k, lines_v) / step_v), axis=1)[:, None]
    return np.asarray(1.0 + 2.0 * ((-1.0) ** k * np.cos(2.0 * np.pi * np.outer(rests, k))) @ share)


def gain_beside_hum(
    channel: Channel, amplitude_v: FloatArray, noise_v_rms: float, through: Callable[[FloatArray], ComplexArray] | None
) -> FloatArray:
    """Return the `step_gain` of a channel's converter beside its hum, as it comes `through` the loop (None: as it is),
    (rests, n)."""
    hum = np.array(channel.environment.hum_v_peak)
    passed = hum if through is None else hum * np.abs(through(np.array(channel.environment.hum_hz)))
    return step_gain(channel.converter.step_v, amplitude_v, noise_v_rms, passed)


def steps_change_db(
    channel: Channel, loop: TwoDegreeLoop, frequency_hz: FloatArray, level_db_sl: float | FloatArray
) -> FloatArray:
    """Return by how much, dB, the converters' steps let a sinusoid of `level_db_sl` move further, (rests, n), for each
    way in which A/D and D/A may rest between two codes.

    Without a loop a D/A rests at a code. No steps raise a loop's gain beyond its margin: there it oscillates by itself,
    which smooths them as noise does.
    """
    noise_v_rms, feedback = channel.environment.noise_v_rms, loop.feedback
    moved = channel.threshold_voltage(frequency_hz) * from_db(level_db_sl)
    command = moved / np.abs(loop.plant.response(frequency_hz))
    if feedback is None:
        return db(step_gain(channel.converter.step_v, command, 0.0, np.empty(0), np.zeros(1)))
    sensed = gain_beside_hum(channel, moved, noise_v_rms, feedback.sensitivity)
    put_out = gain_beside_hum(
        channel, command, noise_v_rms * command_noise_gain(feedback), feedback.command_sensitivity
    )
    both = np.minimum(sensed[:, None] * put_out, from_db(margins(feedback).gain_margin_db))
    through = feedback.open_response(frequency_hz)
    return db(np.abs(put_out * (1.0 + through) / (1.0 + through * both))).reshape(-1, frequency_hz.size)

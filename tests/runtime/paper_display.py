"""The paper's index finger and its controller, built in code: what the core's tests run on."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactuator.model.controller import AntiWindup, ChannelController, Controller, Limits
from tactuator.model.description import Channel, Display, Environment, Threshold
from tactuator.model.plant import Load
from tactuator.perception.curve import curve
from tactuator.signals.discretise import discretise
from tactuator.signals.systems import ContinuousSystem

RATE_HZ = 4000.0
QUIET = Environment(hum_hz=(), hum_v_peak=(), noise_v_rms=0.0, friction_v=0.0)

# Name, sensor gain (V/mm), numerator, denominator, load: the three fingers of the example display.
FINGERS = (
    ("index", 0.19898, 2875.0, (1.0, 94.0, 290.0), (0.12, 31.0, 360.0)),
    ("thumb", 0.2012, 2650.0, (1.0, 101.0, 310.0), (0.15, 38.0, 420.0)),
    ("middle", 0.1967, 3020.0, (1.0, 88.0, 275.0), (0.11, 28.0, 340.0)),
)

# The paper's C and F (facts, section 1).
PAPER_C = ContinuousSystem.from_polynomials(12.264 * np.array([1.0, 111.0, 530.0]), [1.0, 260.0, 0.0])
PAPER_F = ContinuousSystem.from_polynomials(
    565.49 * np.array([1.0, 199.81, 17923.0, 1.786e5]), [1.0, 1420.0, 336711.0, 1.12e7, 1.01e8]
)


def channel(name: str = "index", **changes: object) -> Channel:
    """One finger of the example display."""
    for finger, gain, numerator, denominator, load in FINGERS:
        if finger == name:
            plain = Channel(
                name=finger,
                finger=finger,
                sensor_gain_v_per_mm=gain,
                travel_mm=12.5,
                plant=ContinuousSystem.from_polynomials([numerator], denominator),
                threshold=Threshold(curve("bolanowski-1988")),
                loads=(Load("finger", *load),),
                environment=Environment(),
            )
            return replace(plain, **changes)  # type: ignore[arg-type]
    raise KeyError(name)


def display(*channels: Channel, rate_hz: float = RATE_HZ, delay_samples: int = 1) -> Display:
    """A display of these channels; of all three fingers when none is given."""
    every = channels or tuple(channel(finger[0]) for finger in FINGERS)
    return Display(rate_hz, every, delay_samples, "test")


def feedback_sections(rate_hz: float = RATE_HZ) -> NDArray[np.float64]:
    """The paper's C, bilinear."""
    return discretise(PAPER_C, rate_hz, "bilinear").sections()


def prefilter_sections(threshold_voltage_dc: float, rate_hz: float = RATE_HZ) -> NDArray[np.float64]:
    """The paper's F, bilinear, times the volts per threshold unit at low frequency."""
    sections = discretise(PAPER_F, rate_hz, "bilinear").sections()
    sections[0, :3] *= threshold_voltage_dc
    return sections


def controller(of: Display, command_v: float = 10.0, gains: tuple[float, float] = (0.0, 0.0)) -> Controller:
    """The paper's F and C on every channel."""
    channels = []
    for each in of.channels:
        dc = float(each.threshold_voltage(0.4))
        channels.append(
            ChannelController(
                name=each.name,
                threshold_voltage_dc=dc,
                prefilter_sos=prefilter_sections(dc, of.rate_hz),
                feedback_sos=feedback_sections(of.rate_hz),
                anti_windup=AntiWindup(gains),
                limits=Limits(command_v, each.sensor_gain_v_per_mm * each.travel_mm),
            )
        )
    return Controller(of, tuple(channels))


def changed(made: Controller, **fields: object) -> Controller:
    """The same controller with fields of every channel changed."""
    return replace(made, channels=tuple(replace(each, **fields) for each in made.channels))  # type: ignore[arg-type]


def louder(made: Controller, gain: float) -> Controller:
    """The same with its first channel's feedback `gain` times as strong, on every channel: unstable, for most."""
    sections = np.array(made.channels[0].feedback_sos)
    sections[0, :3] *= gain
    return changed(made, feedback_sos=sections)


def tone(
    frequency_hz: float, duration_s: float, level_db: float = 0.0, rate_hz: float = RATE_HZ
) -> NDArray[np.float64]:
    """A sinusoid, `level_db` re amplitude 1, shape (n,)."""
    time_s = np.arange(round(duration_s * rate_hz)) / rate_hz
    made: NDArray[np.float64] = 10.0 ** (level_db / 20.0) * np.sin(2.0 * np.pi * frequency_hz * time_s)
    return made


def lock_in(samples: NDArray[np.float64], frequency_hz: float, rate_hz: float = RATE_HZ) -> complex:
    """Complex amplitude at `frequency_hz` of a record that holds whole periods."""
    time_s = np.arange(samples.shape[0]) / rate_hz
    return complex(2.0 * np.mean(samples * np.exp(-2j * np.pi * frequency_hz * time_s)))

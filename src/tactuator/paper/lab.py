"""From a device to a controller: calibrate, record, identify, design, listen to the environment, build.

Every step leaves its file in the study's folder, as a laboratory would have it, and the display file names them. The
device is simulated, and seen through its sensor and a dial gauge alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import tactuator as tt
from tactuator.api.designed import ControllerResult
from tactuator.api.response import FeltLevels
from tactuator.arrays import FloatArray
from tactuator.identification.calibration import Calibration
from tactuator.identification.result import Identification
from tactuator.model.description import Channel, Display
from tactuator.paper.plan import DEFAULT_POLES, PROPORTIONAL_GAINS, Plan, Progress, default_display
from tactuator.signals.record import Record

DISPLAY, CONTROLLER, IMAGE, ENVIRONMENT = "display.toml", "controller.json", "image.bin", "environment.json"

GAUGE_ERROR_MM = 0.01
"""Standard error of one reading of the dial gauge (its division)."""
_POSITION_COUNT = 21
_SETTLE_S, _READ_S = 3.0, 0.5
_TRAVEL_SHARE = 0.8
RECORD_S = 20.4


@dataclass(frozen=True)
class Lab:
    """The device as the study knows it. folder: the files of every step; records: command and position of each channel
    (n,), volts; noise: felt under each probing gain and under the controller.
    """

    folder: Path
    calibrations: dict[str, Calibration]
    records: dict[str, Record]
    motors: dict[str, Identification]
    noise: FeltLevels
    controller: ControllerResult

    @property
    def display(self) -> Display:
        """Return the display as the study's file describes it."""
        return self.controller.display


def set_up(plan: Plan, folder: Path, progress: Progress) -> Lab:
    """Take the simulated device from its first calibration to an image for its board, in files of `folder`."""
    calibrations = calibrate(plan)
    progress("calibration", 1.0)
    motors = {}
    records = {channel.name: record_motor(plan, channel.name) for channel in plan.display.channels}
    for done, (name, record) in enumerate(records.items(), start=1):
        fit = tt.identify(record, order=2, zeros=0, out=folder / f"{name}.model.json")
        assert isinstance(fit, Identification)
        motors[name] = fit
        progress("identification", done / len(records))
    write_display(folder, calibrations)
    designed = tt.design(folder / DISPLAY)
    progress("design", 1.0)
    rig = tt.SimulatedRig(plan.display, plan.seed_of("noise"))
    noise = tt.measure_noise(rig, designed, gains=PROPORTIONAL_GAINS, write=folder / ENVIRONMENT)
    with (folder / DISPLAY).open("a", encoding="utf-8") as file:
        file.write(f'\n[environment]\nmeasured = "{ENVIRONMENT}"\n')
    controller = designed.on(tt.read_display(folder / DISPLAY))
    controller.write(folder / CONTROLLER)
    tt.build_image(controller, folder / IMAGE)
    progress("noise", 1.0)
    return Lab(folder, calibrations, records, motors, noise, controller)


def write_display(folder: Path, calibrations: dict[str, Calibration]) -> None:
    """Write the example's display file with gains and models as found, and with the default's poles and touch."""
    with TemporaryDirectory() as examples:
        tt.init(examples=Path(examples) / "examples")
        text = (Path(examples) / "examples" / DISPLAY).read_text(encoding="utf-8")
    for name, calibration in calibrations.items():
        head, mark, own = text.partition(f'name = "{name}"')
        own = re.sub(
            r"sensor_gain_v_per_mm = \S+", f"sensor_gain_v_per_mm = {calibration.gain_v_per_mm:.6g}", own, count=1
        )
        text = head + mark + re.sub(r"plant = \{.*\}", f'plant = "{name}.model.json"', own, count=1)
    text = re.sub(r"poles = \d+", f"poles = {DEFAULT_POLES}", text)
    (folder / DISPLAY).write_text(f"{text}\n[touch]\nadaptive = true\n", encoding="utf-8")


def calibrate(plan: Plan) -> dict[str, Calibration]:
    """Calibrate every channel's sensor gain from steady positions over 80 % of the travel, read by gauge and by sensor.

    The gauge errs by GAUGE_ERROR_MM; the sensor is averaged over half a second.
    """
    rig = tt.SimulatedRig(plan.display, plan.seed_of("calibration"))
    rng = np.random.default_rng(plan.seed_of("dial gauge"))
    readings: dict[str, list[float]] = {name: [] for name in rig.channels}

    def steady(samples: FloatArray) -> float:
        return float(np.mean(samples[-round(_READ_S * rig.rate_hz) :]))

    def note(name: str, displacement_mm: FloatArray) -> None:
        readings[name].append(steady(displacement_mm))

    for name in rig.channels:
        rig.finger(name).attach(partial(note, name))
    reaching_v = np.array([_reaching_v(channel) for channel in plan.display.channels])
    sensed = []
    for share in np.linspace(-_TRAVEL_SHARE, _TRAVEL_SHARE, _POSITION_COUNT):
        trace = rig.drive(np.tile(share * reaching_v, (round((_SETTLE_S + _READ_S) * rig.rate_hz), 1)))
        sensed.append([steady(column) for column in trace.position_v.T])
    calibrations: dict[str, Calibration] = {}
    for read, name, volts in zip(readings.values(), rig.channels, np.transpose(sensed), strict=True):
        displacement_mm = np.array(read) + GAUGE_ERROR_MM * rng.standard_normal(_POSITION_COUNT)
        calibrations[name] = tt.calibrate_sensor((displacement_mm, volts), GAUGE_ERROR_MM)
    return calibrations


def _reaching_v(channel: Channel) -> float:
    """Return the volts of command that hold the channel at the end of its travel."""
    return channel.travel_mm * channel.sensor_gain_v_per_mm / float(np.abs(channel.plant.response(0.0)))


def record_motor(plan: Plan, channel: str) -> Record:
    """Record one channel under the paper's delimiter, steps, noise and sinusoids, without controller and finger."""
    rig = tt.SimulatedRig(plan.display, plan.seed_of(f"record of {channel}"))
    return tt.record(
        plan.display, channel, duration_s=RECORD_S, excitation="delimited", travel_share=_TRAVEL_SHARE, rig=rig,
        seed=plan.seed_of("excitation"),
    ).taken  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """The known truth, beside what was found, as a check of the simulation. motor_error_db: the greatest error of an
    identified response over the band, by channel; design_error_db: the greatest change of the felt level, free or
    touched, by designing for what was identified instead of the true display.
    """

    motor_error_db: dict[str, float]
    design_error_db: float


def compare_with_truth(plan: Plan, lab: Lab) -> Truth:
    """Compare the identified motors with the simulated ones, and the design with the one for the true display."""
    ideal, made = tt.design(default_display(plan.display)), lab.controller.on(plan.display)
    motors, changes = {}, []
    for channel in plan.display.channels:
        hertz = np.geomspace(*channel.threshold.band_hz, 400)
        identified = lab.motors[channel.name].model.response(hertz)
        motors[channel.name] = float(
            np.max(np.abs(20.0 * np.log10(np.abs(identified / channel.plant.response(hertz)))))
        )
        for load in (None, channel.loads[0].name):
            responses = (np.abs(each.response(channel.name, hertz, load)) for each in (made, ideal))
            changes.append(np.abs(20.0 * np.log10(np.divide(*responses))))
    return Truth(motors, float(np.max(changes)))

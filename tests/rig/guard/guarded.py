"""A board in this process, stepped tick by tick, with an eye on the truth that no rig shows."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from tactuator.api.parameters import paper_display
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.model.requirements import Touch
from tactuator.rig.board.link import IMAGE, STREAM, LinkClient, Mode, Request
from tactuator.rig.board.rig import SENSOR_FAULTS, BoardRig
from tactuator.rig.transport import InProcess
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.image import build_image
from tactuator.runtime.safety_table import Fault
from tactuator.synthesis.design import design_controller

SENSORS = SENSOR_FAULTS[:5]


@cache
def designed() -> Controller:
    return design_controller(paper_display())


@cache
def adaptive() -> Controller:
    return design_controller(replace(paper_display(), touch=Touch(adaptive=True)))


def spoilt(controller: Controller, gain: float) -> Controller:
    """The same with its feedback `gain` times as strong: unstable, for most."""
    channels = []
    for channel in controller.channels:
        sections = np.array(channel.feedback_sos)
        sections[0, :3] *= gain
        channels.append(replace(channel, feedback_sos=sections))
    return replace(controller, channels=tuple(channels))


@dataclass
class Run:
    """Of every tick: displacement (mm), command at the motor (V), and the fault that stands; fault_at: first tick."""

    displacement_mm: NDArray[np.float64]
    command_v: NDArray[np.float64]
    fault: Fault
    fault_at: int | None


class Guarded:
    """`controller` on an in-process board; `drives`: the stream goes straight to the motors."""

    def __init__(self, controller: Controller, drives: bool = False, seed: int = 1) -> None:
        self.display: Display = controller.display
        self.transport = InProcess()
        self.rig = BoardRig(LinkClient(self.transport), self.display)
        self.rig.simulate(seed)
        self.rig.client.upload(IMAGE, build_image(controller))
        self.rig.client.must(Request.ARM)
        self.board, self.simulated = self.transport.board, self.transport.simulated
        self.drives = drives
        self.start()

    def start(self) -> None:
        assert lib.tact_board_start(self.board, self.board.run + 1, STREAM, self.drives, 0)

    def leave(self) -> None:
        """To ARMED, in its own time."""
        assert lib.tact_board_stop(self.board)

    def restart(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Stopped, and started again as soon as that is allowed; what moved until then while `rows` go on."""
        self.leave()
        moved = []
        for row in rows:
            if self.mode is not Mode.RUNNING:
                break
            moved.append(self.run(row[None, :]).displacement_mm)
        if self.mode is Mode.ARMED:
            self.start()
        return np.concatenate(moved)

    @property
    def mode(self) -> Mode:
        return Mode(self.board.mode)

    def touch(self, yes: bool) -> None:
        for channel in range(3):
            self.simulated.state[channel].touched = int(yes)

    def break_sensor(self, what: str, channel: int = 0, value: float = 0.0) -> None:
        fault = ffi.addressof(self.simulated.sensor[channel])
        lib.tact_sensor_fault_set(fault, SENSOR_FAULTS.index(what), value, self.simulated.code[channel])

    def run(self, rows: NDArray[np.float64], lateness: int = 0, heard: bool = True) -> Run:
        """One tick for each row of the reference (n, 3)."""
        wants = np.ascontiguousarray(rows, dtype=np.float32)
        count = wants.shape[0]
        moved, command = np.zeros((count, 3)), np.zeros((count, 3))
        at: int | None = None
        for k in range(count):
            row = ffi.from_buffer("float[]", wants[k])
            lib.tact_board_stream(self.board, self.board.tick, row, 1)
            if heard:
                self.board.silence = 0
            lib.tact_simulated_board_period(self.simulated, self.board, lateness)
            for channel in range(3):
                state = self.simulated.state[channel]
                moved[k, channel], command[k, channel] = state.displacement_mm, state.motor_v
            if at is None and self.board.mode == lib.TACT_FAULT:
                at = k
        return Run(moved, command, Fault(self.board.fault), at)

"""Cycles of a connected board, from its counter to what the host tells: the silicon's own file on a model of the
counter, the core's link, and the host's requests."""

import ctypes

import pytest

from tactuator.errors import BadInput, DeviceFault
from tactuator.rig.board.link import LinkClient
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.period_cost import count_cycles
from tactuator.rig.transport import InProcess
from tactuator.runtime._core import ffi, lib
from tests.firmware.chip_model import Chip, Drivers, build
from tests.rig.guard.guarded import designed

AT_REST, RUNS, EVERY_TENTH = 90, 700, 25


class Counted(InProcess):
    """A board whose time goes on with every request, in whose every period the chip's counter goes on as well: the step
    takes 90 cycles at rest, 700 in a run, and 25 more in every tenth."""

    def __init__(self, library: ctypes.CDLL, goes: bool = True) -> None:
        super().__init__(name="stm32f405")
        self.on, self.goes = Drivers(library, Chip()), goes
        self.on.call("tact_cycles_start")
        address = ctypes.cast(library.tact_cycles_count, ctypes.c_void_p).value
        self.link.bench = ffi.cast("void (*)(uint32_t, uint32_t *)", address)

    def _let_run(self) -> None:
        for _ in range(32 * self.goes):
            runs = self.board.mode == lib.TACT_RUNNING
            self.on.chip.cycles = 0xFFFFFFFF - 40  # the counter's end is within every step
            self.on.call("tact_cycles_from")
            self.on.chip.passes((RUNS if runs else AT_REST) + EVERY_TENTH * (self.board.ticks % 10 == 0))
            self.on.call("tact_cycles_to")
            if self.simulated.channels:
                lib.tact_simulated_board_period(self.simulated, self.board, 0)
            else:
                self.board.ticks += 1


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return build(tmp_path_factory.mktemp("drivers"))


def rig_of(transport: InProcess) -> BoardRig:
    made = BoardRig(LinkClient(transport), designed().display, waits=False, sleep=lambda seconds: None)
    made.simulate(1)
    transport.board.allows_hold = 0  # as a board with converters says
    return made


def test_count_cycles__known_to_the_cycle__are_told_of_each_case(library, monkeypatch):
    monkeypatch.setattr("tactuator.rig.period_cost.count_instructions", refuse)
    found = count_cycles(rig_of(Counted(library)), designed(), 0.1, sleep=lambda seconds: None)
    assert (found.board, found.channels, list(found.cases)) == ("stm32f405", 3, ["at rest", "silent", "usual"])
    for name, step in (("at rest", AT_REST), ("silent", RUNS), ("usual", RUNS)):
        case = found.cases[name]
        assert (case.periods, case.least, case.most) == (400, step, step + EVERY_TENTH)
        assert case.mean == step + EVERY_TENTH / 10.0
        assert case.share_of_period == pytest.approx((step + EVERY_TENTH) * 4000.0 / 168e6)
        assert case.instructions is None


def refuse(*arguments):
    raise BadInput("no emulator")


def test_count_cycles__board_without_a_counter_or_with_a_simulated_display__is_refused():
    made = rig_of(transport := InProcess())
    for allows_hold, words in ((0, "no counter of cycles; allowed: one that has"), (1, "simulated display; allowed")):
        transport.board.allows_hold = allows_hold
        with pytest.raises(BadInput, match=words):
            count_cycles(made, designed(), 0.1)


def test_count_cycles__timer_that_stands__is_told(library):
    now_s = iter(range(1000))
    made = rig_of(Counted(library, goes=False))
    with pytest.raises(DeviceFault, match="has not made 400 periods"):
        count_cycles(made, designed(), 0.1, clock=lambda: float(next(now_s)), sleep=lambda seconds: None)

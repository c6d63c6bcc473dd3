"""A connected board's commands are computed again from its readings: what differs is found."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from firmware.__main__ import main
from firmware.verify import verify
from tactuator.errors import BadInput
from tactuator.io.controller import write_controller
from tactuator.model.controller import Controller
from tactuator.rig.board.link import LinkClient
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.open import in_process_rig
from tactuator.rig.transport import InProcess
from tests.firmware.emulated_ports import judged, socket_board
from tests.firmware.emulator import MACHINES, Emulator, emulated_rig
from tests.rig.every_rig import free_rig
from tests.rig.guard.guarded import adaptive, designed
from tests.strength import reshaped

RIGS: dict[str, Callable[[Controller], BoardRig]] = {
    "in-process": lambda of: in_process_rig(of.display, 1),
    "time that goes on": lambda of: free_rig(),
    "mps2-an500": lambda of: emulated_rig("mps2-an500", of.display, 1),
}


@pytest.mark.parametrize("opened", RIGS.values(), ids=RIGS)
@pytest.mark.parametrize("of", [designed, lambda: reshaped(designed())], ids=["designed", "reshaped"])
def test_verify__board_of_this_core__every_command_is_ours(opened, of) -> None:
    with opened(of()) as rig:
        found = verify(rig, of(), 1.0)
    assert (found.first_difference, found.late, found.holds) == (None, 0, True)
    assert found.ticks >= 4000


def test_verify__finger_fed_forward__every_command_is_ours() -> None:
    with in_process_rig(adaptive().display, 1) as rig:
        assert verify(rig, adaptive(), 1.0).holds


class Wrong(InProcess):
    """A board whose arithmetic goes wrong in its last bit, once."""

    def _let_run(self) -> None:
        super()._let_run()
        if self.board.tick > 2000:
            controller = self.board.image.controller[1]
            controller.prefilter[0].b0 = np.nextafter(np.float32(controller.prefilter[0].b0), np.float32(9.0))


def test_verify__last_bit_of_a_coefficient__is_noticed_at_its_tick() -> None:
    with closing(rig := free_rig(Wrong())):
        found = verify(rig, designed(), 1.0)
    assert found.first_difference is not None
    assert 2000 < found.first_difference < 3000
    assert not found.holds


def test_verify__less_than_a_second_or_another_displays_table__is_refused() -> None:
    with in_process_rig(designed().display) as rig:
        with pytest.raises(BadInput, match=r"0\.5 s; expected a second or more"):
            verify(rig, designed(), 0.5)
        other = replace(designed(), display=replace(designed().display, objectives=replace(
            designed().display.objectives, comfort_db_sl=50.0)))  # fmt: skip
        with pytest.raises(BadInput, match="another display's safety table"):
            verify(rig, other, 1.0)


def test_verify__late_interrupt__does_not_hold() -> None:
    class Late(InProcess):
        def _let_run(self) -> None:
            super()._let_run()
            self.board.late += 1

    with closing(rig := free_rig(Late())):
        assert not verify(rig, designed(), 1.0).holds


@pytest.mark.parametrize("seconds", [1.0, pytest.param(10.0, marks=pytest.mark.soak)])
def test_verify__emulated_stm32f405_in_free_run__no_interrupt_is_late(seconds: float) -> None:
    """Its whole program but for clock and converters, at 125 million instructions a second."""
    with judged(), closing(LinkClient(Emulator(MACHINES["stm32f405"], uart=True), 20.0)) as client:
        rig = BoardRig(client, designed().display, waits=False)
        rig.simulate(1)
        found = verify(rig, designed(), seconds)
    assert found.holds
    assert 0 < found.cycles < 42_000 / 4  # bytes that come in the middle of a step among them


@pytest.mark.slow
def test_firmware__verify_over_a_port__says_so_and_ends_with_0_or_refuses(tmp_path, capsys) -> None:
    write_controller(tmp_path / "c.json", designed())
    words = ["verify", "--controller", str(tmp_path / "c.json"), "--seconds", "1", "--rig"]
    with socket_board() as (url, _):
        assert main([*words, f"board:{url}"]) == 0
    said = capsys.readouterr().out
    assert "mps2-an500: commands of 4000 ticks are bit for bit this machine's; 0 interrupts were late" in said
    assert main([*words, "simulated"]) == 2
    assert "rig 'simulated' is no connected board; expected board:PORT or board:URL" in capsys.readouterr().err

"""The bit check: the states that it goes on from."""

import struct

from tactuator.rig.board.frames import Request
from tactuator.rig.boards import in_process_rig
from tactuator.runtime.image import build_image
from tests.rig.guard.guarded import designed


def bit_checked(rig, samples: int, restart: bool) -> bytes:
    return rig.client.must(Request.BIT_CHECK, struct.pack("<IIB", 0, samples, restart))


def test_bit_check__another_image_in_between__begins_anew() -> None:
    """Found by fuzzing: a Q31 controller went on from a float32 one's states, beyond what its accumulators hold."""
    digests = []
    for before in (None, "float32", "q31"):
        with in_process_rig(designed().display, 1) as rig:
            if before:
                rig.load_image(build_image(designed(), before, "0" * 64))
                bit_checked(rig, 500, True)
            rig.load_image(build_image(designed(), "q31", "1" * 64))
            digests.append(bit_checked(rig, 500, before is None))
    assert digests[0] == digests[1] == digests[2]


def test_bit_check__in_pieces__is_one() -> None:
    with in_process_rig(designed().display, 1) as rig:
        rig.load(designed())
        whole = bit_checked(rig, 900, True)
        bit_checked(rig, 350, True)
        assert bit_checked(rig, 550, False) == whole

"""One suite for every rig, own ones included: what the protocol promises, and what each refuses in the same words.

TACTUATOR_RIG names one more (docs/rig.md). A rig without finger ports is asked for all but those.

The simulated rig: the protocol, its blindness, and its finger ports.
"""

from dataclasses import fields, replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.measure.options import MeasurementOptions
from tactuator.measure.response import multisine_response
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.rig import simulated
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.rig import Rig, Trace, join_traces
from tactuator.rig.simulated import PacedRig, SimulatedRig
from tests.rig.every_rig import BOARDS, RIGS, begin, tones
from tests.rig.guard.guarded import adaptive, designed
from tests.runtime import paper_display
from tests.runtime.paper_display import controller, display
from tests.strength import reshaped

#: For tests that play a second and more: the example of docs/rig.md is computed in Python, sample by sample.
_long = pytest.mark.parametrize("opened", sorted(RIGS.keys() - {"docs/rig.md"}), indirect=True, scope="module")


@pytest.fixture(scope="module", params=RIGS)
def opened(request):
    """A rig's name, and a board that is kept from test to test; None for what is opened anew."""
    if request.param in BOARDS or request.param.startswith("emulated:"):
        with RIGS[request.param](designed().display) as board:
            yield request.param, board
    else:
        yield request.param, None


@pytest.fixture
def rig(opened):
    """As if it had just been opened, with its controller: no test leans on the one before."""
    name, board = opened
    if board is not None:
        begin(board)
        yield board
        return
    with RIGS[name](designed().display) as fresh:
        fresh.load(designed())
        yield fresh


@pytest.fixture
def touched(rig) -> Rig:
    if not rig.has_finger_ports:
        pytest.skip("its display is real")
    return rig


def at_rest(rig: Rig) -> bool:
    """Whether the motors get nothing; of a simulated display, what was still to come out of its computing delay."""
    if isinstance(rig, BoardRig):
        return rig.status().at_rest
    return bool(np.max(np.abs(rig.play(np.zeros((1, 3))).command_v)) < 1e-3)


@pytest.mark.parametrize("name", sorted(RIGS.keys() - {"emulated:mps2-an500"}))
def test_play__before_any_controller__is_refused(name: str) -> None:
    with RIGS[name](designed().display) as rig:
        with pytest.raises(BadInput, match="no controller is loaded: load one before playing a reference"):
            rig.play(tones(10))
        with pytest.raises(BadInput, match="no controller is loaded"):
            list(rig.stream([tones(10)]))


def test_play__three_tones__trace_has_every_sample_in_the_steps_of_the_converters(rig: Rig) -> None:
    assert isinstance(rig, Rig)
    assert (rig.rate_hz, rig.channels) == (4000.0, ("index", "thumb", "middle"))
    trace = rig.play(tones())
    assert (len(trace), trace.channels, trace.rate_hz) == (600, rig.channels, 4000.0)
    assert (trace.duration_s, trace.time_s[1], trace.channel("thumb")) == (0.15, 1.0 / 4000.0, 1)
    assert trace.saturated.dtype == bool
    np.testing.assert_allclose(trace.reference, tones(), rtol=2.0**-23, atol=1e-30)
    for index, channel in enumerate(designed().display.channels):
        step_v = channel.converter.step_v
        for volts in (trace.command_v[:, index] - channel.converter.offset_v, trace.position_v[:, index]):
            codes = volts / step_v
            np.testing.assert_allclose(codes, np.round(codes), atol=0.01)
            assert np.max(np.abs(codes)) > 20.0
    assert not trace.saturated.any()


def test_play_and_stream__blocks_of_any_length__are_the_reference_without_a_gap(rig: Rig) -> None:
    """Time stands still between blocks: the second begins where the first ended."""
    traces = [rig.play(part) for part in (tones(800)[:700], tones(800)[700:])]
    cut = join_traces(traces, rig.rate_hz, rig.channels)
    before, after = cut.command_v[699], cut.command_v[700]
    steps = np.abs(np.diff(cut.command_v, axis=0))
    assert np.all(np.abs(after - before) <= np.max(steps[100:690], axis=0))
    assert len(cut) == 800
    assert len(rig.play(np.zeros((0, 3)))) == len(rig.drive(np.zeros((0, 3)))) == len(list(rig.stream([]))) == 0
    blocks = [tones()[:1], tones()[1:1], tones()[1:500], tones()[500:]]
    whole = join_traces(rig.stream(iter(blocks)), rig.rate_hz, rig.channels)
    np.testing.assert_allclose(whole.reference, tones(), rtol=2.0**-23, atol=1e-30)
    rig.play(tones(233))
    rig.rest()
    assert at_rest(rig)


def test_play__numbers_of_any_kind_and_layout__are_taken_alike(rig: Rig) -> None:
    layouts = (np.ndarray.tolist, np.asfortranarray, lambda rows: np.repeat(rows, 2, axis=0)[::2])
    for kind, layout in product((float, np.float32, np.int16, bool), layouts):
        reference = (np.arange(24).reshape(8, 3) % 5).astype(kind)
        trace = rig.play(layout(reference))
        assert np.array_equal(trace.reference, reference.astype(float))
        assert trace.reference.dtype == np.float64
        assert not np.shares_memory(trace.reference, reference)


NO_BLOCKS = [
    (np.zeros((10, 2)), r"has shape \(10, 2\); expected \(samples, 3\)"),
    (np.zeros(30), r"has shape \(30,\); expected \(samples, 3\)"),
    (np.zeros((10, 3), dtype=complex), "holds complex128; expected real numbers"),
    (np.full((10, 3), None), "holds object; expected real numbers"),
    ([[1, 2, 3], [1, 2]], "has rows of unequal length; "),
]


def test_play_and_drive__what_is_none__is_told_and_the_output_rests(rig: Rig) -> None:
    told = "not finite or beyond 60 dB SL; expected finite, at most 1000 threshold units"
    rig.play(tones(200))
    for value, tick, channel in ((np.nan, 0, 0), (-np.inf, 49, 2), (1000.001, 49, 0), (-1000.001, 0, 2), (1e300, 3, 1)):
        rows = tones(50)
        rows[tick, channel] = value
        with pytest.raises(BadInput, match=told):
            rig.play(rows)
        assert at_rest(rig)
    with pytest.raises(BadInput, match=told):
        list(rig.stream([tones(300), rows]))
    assert at_rest(rig)
    for value in (np.nan, 1e39):
        with pytest.raises(BadInput, match="the command is not finite; expected volts"):
            rig.drive(np.full((50, 3), value))
        assert at_rest(rig)
    for rows, said in NO_BLOCKS:
        with pytest.raises(BadInput, match="reference " + said):
            rig.play(rows)
        with pytest.raises(BadInput, match="command " + said):
            rig.drive(rows)


def test_stream__of_what_has_no_blocks__is_refused_at_the_call(rig: Rig) -> None:
    allowed = r"it must be a list or a generator of references, \(n, 3\) each"
    for blocks in (None, 3, "tones", np.array(2)):
        with pytest.raises(BadInput, match=f"^blocks is .*; {allowed}"):
            rig.stream(blocks)


def test_load__controller_of_other_channels_or_rate__is_refused(rig: Rig) -> None:
    of = paper_display.display(paper_display.channel())
    with pytest.raises(BadInput, match="controller is for channels index; expected index, thumb, middle"):
        rig.load(paper_display.controller(of))
    with pytest.raises(BadInput, match="controller is for 8000 Hz and a delay of 1; expected 4000 Hz and 1, as"):
        rig.load(Controller(replace(designed().display, rate_hz=8000.0), designed().channels))
    assert len(rig.play(tones(20))) == 20


@pytest.mark.parametrize(
    ("does", "made", "words"),
    [
        ("reshapes", lambda: reshaped(designed()), r"its reference is reshaped .* without \[strength\] blended"),
        ("feeds_forward", adaptive, r"what a finger takes is fed forward.* without \[touch\] adaptive"),
    ],
)
def test_load__controller_that_does_more__is_played_so_or_refused(rig: Rig, does: str, made, words: str) -> None:
    """A rig of another package, and one of ours, played it as it came, and said nothing."""
    plain = rig.play(tones()).position_v
    if getattr(rig, does):
        rig.load(made())
        if does == "reshapes":
            assert np.max(np.abs(rig.play(tones()).position_v - plain)) > 0.05 * np.max(np.abs(plain))
    else:
        with pytest.raises(BadInput, match=f"'index': {words}"):
            rig.load(made())
    assert len(rig.play(tones(20))) == 20


def test_drive__constant__reaches_the_motor_and_then_the_sensor(rig: Rig) -> None:
    trace = rig.drive(np.full((400, 3), 0.1))
    assert np.all(np.abs(trace.command_v[-1] - 0.1) < 1e-3)
    assert np.all(trace.position_v[-1] > 0.05)
    assert not trace.reference.any()


def test_finger__pressed__is_felt_where_and_while_it_presses(touched: Rig) -> None:
    felt: dict[str, list] = {"index": [], "middle": []}
    for name, pieces in felt.items():
        touched.finger(name).attach(pieces.append)
    touched.finger("middle").press(np.full(300, 0.5))
    touched.play(np.zeros((200, 3)))
    touched.play(np.zeros((200, 3)))
    for name, pieces in felt.items():
        touched.finger(name).detach(pieces.append)
    index, middle = (np.concatenate(felt[name]) for name in ("index", "middle"))
    assert index.size == middle.size == 400
    assert np.max(np.abs(index)) < 0.02 < 0.05 < np.max(np.abs(middle[:300]))
    before = middle.size
    touched.play(np.zeros((20, 3)))
    assert np.concatenate(felt["middle"]).size == before


@_long
def test_finger__touched__takes_level_at_high_frequencies(touched: Rig) -> None:
    felt: list = []
    reference = np.zeros((1600, 3))
    reference[:, 2] = 30.0 * np.sin(2.0 * np.pi * 200.0 * np.arange(1600) / 4000.0)
    touched.finger("middle").attach(felt.append)
    levels = []
    for load in (None, "finger"):
        touched.finger("middle").touch(load)
        touched.play(reference)
        whole = np.concatenate(felt)[-1200:]
        levels.append(abs(np.mean(whole * np.exp(-2j * np.pi * 200.0 * np.arange(1200) / 4000.0))))
        felt.clear()
    touched.finger("middle").touch(None)
    touched.finger("middle").detach(felt.append)
    assert 0.5 < 20.0 * np.log10(levels[0] / levels[1]) < 12.0


def test_finger__of_no_channel_or_under_no_load_or_pressed_by_nothing__is_refused(touched: Rig) -> None:
    with pytest.raises(BadInput, match="no channel 'ring'; expected index, thumb, middle"):
        touched.finger("ring")
    with pytest.raises(BadInput, match="no load 'glove'; expected none, finger"):
        touched.finger("index").touch("glove")
    for force in ([[0.1, 0.2]], [np.nan]):
        with pytest.raises(BadInput, match=r"\(n,\), finite volts of command"):
            touched.finger("index").press(force)
    with pytest.raises(BadInput, match="force holds"):
        touched.finger("index").press("a")
    with pytest.raises(BadInput, match="not attached"):
        touched.finger("index").detach(print)


@_long
def test_measure__multisine__is_the_response_of_the_simulated_display(rig: Rig) -> None:
    plain = SimulatedRig(designed().display, 2)
    plain.load(designed())
    options = MeasurementOptions(35.0, longest_s=0.5, confidence_db=0.3)
    measured = [
        multisine_response(each, [55.0, 200.0], options, np.random.default_rng(2), settle_s=0.5)
        for each in (rig, plain)
    ]
    for found, wanted in zip(*measured, strict=True):
        bound = found.confidence_db + wanted.confidence_db + 0.03  # float32 on the board
        assert np.all(np.abs(found.magnitude_db - wanted.magnitude_db) < bound)


THREE = display()


def loaded_rig(seed: int = 0, of: Display = THREE) -> SimulatedRig:
    rig = SimulatedRig(of, seed)
    rig.load(controller(of))
    return rig


def test_trace__holds_what_the_processor_knows_and_no_truth() -> None:
    names = "rate_hz channels reference command_v position_v saturated"
    assert [field.name for field in fields(Trace)] == names.split()
    port = {name for name in dir(SimulatedRig(display()).finger("index")) if not name.startswith("_")}
    assert port == {"touch", "load", "press", "attach", "detach"}


def test_finger__press_twice__adds_up() -> None:
    twice, once = SimulatedRig(display()), SimulatedRig(display())
    results = []
    for rig, presses in ((twice, ([0.25] * 300, [0.25] * 500)), (once, ([0.5] * 300 + [0.25] * 200,))):
        felt: list[np.ndarray] = []
        rig.finger("index").attach(felt.append)
        for press in presses:
            rig.finger("index").press(press)
        rig.drive(np.zeros((600, 3)))
        results.append(felt[0])
    assert np.array_equal(*results)


def test_play__one_channel_as_a_vector__is_taken() -> None:
    assert loaded_rig(of=display(paper_display.channel())).play(np.zeros(10)).reference.shape == (10, 1)


def test_trace__unequal_shapes__are_refused() -> None:
    column = np.zeros((4, 1))
    with pytest.raises(BadInput, match=r"trace: position_v has shape \(3, 1\); expected \(4, 1\)"):
        Trace(4000.0, ("index",), column, column, column[:3], column.astype(bool))


def test_paced_rig__stream__is_the_stream_of_the_rig_below():
    blocks = np.array_split(20.0 * np.random.default_rng(1).standard_normal((1000, 3)), 4)
    positions = []
    for pace in (lambda rig: rig, lambda rig: PacedRig(rig, speed=1e6)):
        rig = loaded_rig(1)
        positions.append(join_traces(pace(rig).stream(iter(blocks)), rig.rate_hz, rig.channels).position_v)
    assert np.array_equal(*positions)
    assert len(positions[0]) == 1000


@pytest.mark.parametrize(("held_up_s", "lasts_s"), [(0.02, 0.2), (0.1, 0.298)])
def test_paced_rig__stream_held_up__catches_up_within_a_cards_lead_and_does_not_hurry_after_more(
    monkeypatch, held_up_s, lasts_s
):
    clock = SimpleNamespace(now_s=0.0, monotonic=lambda: clock.now_s, sleep=lambda s: later(s))

    def later(seconds):
        clock.now_s += seconds

    def held_up():
        for number in range(10):
            later(held_up_s if number == 1 else 0.0)
            yield np.zeros((80, 3))

    monkeypatch.setattr(simulated, "time", clock)
    joined = join_traces(PacedRig(loaded_rig(1)).stream(held_up()), 4000.0, ("index", "thumb", "middle"))
    assert len(joined) == 800
    assert clock.now_s == pytest.approx(lasts_s, abs=0.001)


def test_paced_rig__rest_in_a_tone__is_silent_soon():
    rig, felt = loaded_rig(1), []
    rig.finger("index").attach(felt.append)
    paced = PacedRig(rig, speed=10.0)
    wave = np.zeros((4000, 3))
    wave[:, 0] = 31.6 * np.sin(2.0 * np.pi * 100.0 * np.arange(4000) / rig.rate_hz)
    stream = paced.stream([wave])
    played = 0
    while played < 1000:
        played += len(next(stream))
    loud = np.abs(np.diff(np.concatenate(felt)[-200:])).max()
    felt.clear()
    paced.rest()
    moved = np.abs(np.diff(np.concatenate(felt)))
    assert loud > 20.0 * moved[60:260].max()  # 15 ms later
    assert loud > 20.0 * moved[260:].max()  # nor when the motor is let go

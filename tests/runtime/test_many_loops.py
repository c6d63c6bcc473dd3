"""Many loops at once give, bit for bit, what each gives alone, whatever the width of the vectors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from tactuator.errors import BadInput
from tactuator.model.controller import AntiWindup, ChannelController, Limits
from tactuator.model.description import Channel, Converter, Environment
from tactuator.runtime.many_loops import KERNELS, Loop, ManyLoops, kernels_available
from tactuator.runtime.simulation import SimulatedBlock, Simulation
from tactuator.signals.systems import ContinuousSystem
from tests.runtime.paper_display import RATE_HZ, channel, controller, display, lock_in, prefilter_sections, tone

VECTORS = tuple(kernel for kernel in kernels_available() if kernel not in ("widest", "single"))


def designed(of: Channel, **changes: object) -> ChannelController:
    return replace(controller(display(of)).channels[0], **changes)  # type: ignore[arg-type]


def various(count: int, delay_samples: int = 1) -> list[Loop]:
    """Loops of every kind: fingers, loads, converters, limits, anti-windup; same structure within each sixteen."""
    rng = np.random.default_rng(11)
    loops = []
    for i in range(count):
        finger = ("index", "thumb", "middle")[i % 3]
        wiring = Converter(polarity=1 - 2 * (i % 2), offset_v=0.1 * (i % 5), bits=(12, 16, 24)[i % 3])
        environment = Environment(friction_v=0.004 * (i % 4), noise_v_rms=2e-4 * (i % 3))
        of = channel(finger, converter=wiring, environment=environment)
        gains = tuple(rng.uniform(0.0, 0.05, 2).tolist())
        limits = Limits(float(rng.uniform(1.0, 12.0)), 2.0)
        loops.append(
            Loop(of, designed(of, anti_windup=AntiWindup(gains), limits=limits), i, (None, "finger")[i // 2 % 2])
        )
    return loops


def assert_same_bits(ours: SimulatedBlock, theirs: SimulatedBlock) -> None:
    for name in ("command_v", "position_v", "displacement_mm", "saturated", "broken"):
        assert np.array_equal(getattr(ours, name), getattr(theirs, name)), name


@pytest.mark.parametrize("kernel", VECTORS)
@pytest.mark.parametrize("delay_samples", [0, 1, 3])
def test_lanes__every_kernel_and_delay__same_bits_as_the_single_loop(kernel: str, delay_samples: int) -> None:
    loops = various(37)
    reference = 200.0 * np.random.default_rng(1).standard_normal((1500, 37))
    force_v = 0.3 * np.random.default_rng(2).standard_normal((1500, 37))
    one, other = (ManyLoops(loops, RATE_HZ, delay_samples, name) for name in ("single", kernel))
    for part in (slice(0, 700), slice(700, 1500)):
        assert_same_bits(other.play(reference[part], force_v[part]), one.play(reference[part], force_v[part]))


def test_lanes__each__is_the_simulation_of_its_seed() -> None:
    loops = various(20)
    reference = 100.0 * np.random.default_rng(3).standard_normal((800, 20))
    together = ManyLoops(loops, RATE_HZ, 1).play(reference)
    for i, loop in enumerate(loops):
        of = display(loop.channel)
        alone = Simulation(of, loop.seed)
        alone.load(replace(controller(of), channels=(loop.controller,)))
        alone.touch(0, loop.load)
        block = alone.play(reference[:, i : i + 1])
        assert np.array_equal(block.position_v[:, 0], together.position_v[:, i])
        assert np.array_equal(block.displacement_mm[:, 0], together.displacement_mm[:, i])


hostile = hnp.arrays(
    np.float32, st.tuples(st.integers(1, 40), st.just(16)), elements=st.floats(width=32), fill=st.floats(width=32)
)
sos = st.lists(
    st.tuples(*[st.floats(-3.0, 3.0)] * 3, st.just(1.0), st.floats(-2.2, 2.2), st.floats(-1.5, 1.5)),
    min_size=1,
    max_size=3,
).map(np.array)


@settings(max_examples=25)
@given(hostile, sos, st.one_of(st.none(), sos), st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)))
def test_lanes__hostile_references_and_controllers__same_bits(
    reference: NDArray[np.float32],
    prefilter: NDArray[np.float64],
    feedback: NDArray[np.float64] | None,
    gains: tuple[float, float],
) -> None:
    of = channel()
    each = ChannelController("index", 1.0, prefilter, feedback, AntiWindup(gains), Limits(10.0, 2.0))
    loops = [Loop(of, each, seed) for seed in range(16)]
    expected = ManyLoops(loops, RATE_HZ, 1, "single").play(reference)
    for kernel in VECTORS:
        assert_same_bits(ManyLoops(loops, RATE_HZ, 1, kernel).play(reference), expected)


@pytest.mark.parametrize(
    "plant",
    [
        ContinuousSystem(np.empty(0), np.array([-40.0]), 30.0, 3.4 / RATE_HZ),
        ContinuousSystem(np.array([-300.0]), np.array([-20.0, -30.0 + 500j, -30.0 - 500j, -900.0]), 3e6),
        ContinuousSystem(np.array([-300.0, -400.0]), np.array([-20.0, -900.0]), 0.5, 17.0 / RATE_HZ),
    ],
    ids=["first order, split dead time", "fourth order", "direct part, dead time"],
)
def test_lanes__other_plants__same_bits(plant: ContinuousSystem) -> None:
    of = channel(plant=plant, loads=())
    loops = [Loop(of, designed(of, feedback_sos=None), seed) for seed in range(16)]
    reference = 300.0 * np.random.default_rng(4).standard_normal((600, 16))
    expected = ManyLoops(loops, RATE_HZ, 1, "single").play(reference)
    for kernel in VECTORS:
        assert_same_bits(ManyLoops(loops, RATE_HZ, 1, kernel).play(reference), expected)


def test_lanes__mixed_structures__same_bits_through_the_single_loop() -> None:
    loops = various(32)
    short = prefilter_sections(0.004)[:1]
    loops[5] = replace(loops[5], controller=replace(loops[5].controller, prefilter_sos=short))
    reference = 100.0 * np.random.default_rng(5).standard_normal((300, 1))
    single = ManyLoops(loops, RATE_HZ, 1, "single").play(reference)
    assert_same_bits(ManyLoops(loops, RATE_HZ, 1).play(reference), single)


@pytest.mark.parametrize("kernel", kernels_available())
def test_measure__agrees_with_the_trace_and_between_kernels(kernel: str) -> None:
    loops = various(18)
    reference = tone(20.0, 0.5, 46.0)
    block = ManyLoops(loops, RATE_HZ, 1).play(reference)
    metrics = ManyLoops(loops, RATE_HZ, 1, kernel).measure(reference, probe_hz=20.0)
    felt = block.displacement_mm
    assert metrics.displacement_mean_mm == pytest.approx(felt.mean(axis=0), rel=1e-9, abs=1e-12)
    assert metrics.displacement_rms_mm == pytest.approx(np.sqrt((felt**2).mean(axis=0)), rel=1e-12)
    assert np.array_equal(metrics.displacement_peak_mm, np.abs(felt).max(axis=0))
    assert metrics.command_rms_v == pytest.approx(np.sqrt((block.command_v**2).mean(axis=0)), rel=1e-12)
    assert np.array_equal(metrics.command_peak_v, np.abs(block.command_v).max(axis=0))
    assert np.array_equal(metrics.saturated, block.saturated.sum(axis=0))
    turned = np.array([1j * lock_in(column, 20.0) for column in felt.T])
    assert metrics.amplitude_mm == pytest.approx(turned, rel=1e-9)
    reference_metrics = ManyLoops(loops, RATE_HZ, 1, "single").measure(reference, probe_hz=20.0)
    assert np.array_equal(metrics.amplitude_mm, reference_metrics.amplitude_mm)


def test_many_loops__refusals__say_what_is_allowed() -> None:
    loop = Loop(channel(), designed(channel()))
    with pytest.raises(BadInput, match="no loop; allowed: one or more"):
        ManyLoops([], RATE_HZ, 1)
    with pytest.raises(BadInput, match="kernel 'mmx'; allowed on this processor: widest, single, baseline"):
        ManyLoops([loop], RATE_HZ, 1, "mmx")
    with pytest.raises(BadInput, match="delay_samples is 9; allowed: 0 to 8"):
        ManyLoops([loop], RATE_HZ, 9)
    with pytest.raises(BadInput, match="load 'fist' is not described; allowed: none, finger"):
        ManyLoops([replace(loop, load="fist")], RATE_HZ, 1)
    with pytest.raises(BadInput, match="seed is -1"):
        ManyLoops([replace(loop, seed=-1)], RATE_HZ, 1)
    with pytest.raises(BadInput, match=r"reference has shape \(10, 3\); allowed: \(samples, 2\)"):
        ManyLoops([loop, loop], RATE_HZ, 1).play(np.zeros((10, 3)))
    with pytest.raises(BadInput, match="force has 9 samples; allowed: 10"):
        ManyLoops([loop], RATE_HZ, 1).play(np.zeros(10), np.zeros((9, 1)))
    direct = channel(plant=ContinuousSystem(np.array([-5.0]), np.array([-3.0]), 1.0), loads=())
    with pytest.raises(BadInput, match="answers at once; allowed: delay_samples 1 or more"):
        ManyLoops([Loop(direct, designed(direct, feedback_sos=None))], RATE_HZ, 0)


def test_kernels__names__are_the_cores() -> None:
    assert set(kernels_available()) <= set(KERNELS)
    assert {"widest", "single", "baseline"} <= set(kernels_available())

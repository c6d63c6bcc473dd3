"""A reference on a rig with fingers on it: what is felt of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from tactuator.measure.felt import FeltComparison, FeltReport
from tactuator.model.controller import Controller
from tactuator.rig.rig import Rig
from tactuator.rig.touchable import TouchableRig

BLOCK_S = 4.0
SETTLE_S = 0.5
"""How long is listened after the reference's end."""


def felt_of(
    rig: TouchableRig, references: Iterable[NDArray[np.float64]]
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Play blocks (n, channels), threshold units, on a loaded rig; pairs (reference, displacement_mm) of each."""
    felt: list[list[NDArray[np.float64]]] = [[] for _ in rig.channels]
    ports = [(rig.finger(name), pieces.append) for name, pieces in zip(rig.channels, felt, strict=True)]
    for port, feeler in ports:
        port.attach(feeler)
    try:
        for reference in references:
            if not len(reference):
                continue
            rig.play(reference)
            yield reference, np.stack([np.concatenate(pieces) for pieces in felt], axis=1)
            for pieces in felt:
                pieces.clear()
    finally:
        for port, feeler in ports:
            port.detach(feeler)


def compare_felt(rig: TouchableRig, controller: Controller, reference: NDArray[np.float64]) -> FeltReport:
    """Load `controller`, play `reference` (n, channels) from rest, and compare what was felt with what was asked."""
    rig.load(controller)
    comparison = FeltComparison(controller)
    for asked, displacement in felt_of(rig, with_silence(blocks_of(reference, rig.rate_hz), rig)):
        comparison.push(asked, displacement)
    return comparison.finish()


def blocks_of(reference: NDArray[np.float64], rate_hz: float) -> Iterator[NDArray[np.float64]]:
    """Yield an array (n, channels) in blocks of four seconds."""
    length = round(BLOCK_S * rate_hz)
    for start in range(0, len(reference), length):
        yield reference[start : start + length]


def with_silence(references: Iterable[NDArray[np.float64]], rig: Rig) -> Iterator[NDArray[np.float64]]:
    """Yield the blocks, and then half a second of zeros in which the display comes to rest."""
    yield from references
    yield np.zeros((round(SETTLE_S * rig.rate_hz), len(rig.channels)))

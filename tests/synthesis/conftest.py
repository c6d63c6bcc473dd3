"""Tests of the design design anew, each of them."""

import pytest

from tactuator.synthesis import design


@pytest.fixture(autouse=True)
def designed_anew(designs_and_models: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(design, "design_channel", design.design_channel.__wrapped__)  # type: ignore[attr-defined]

"""The whole study, run once with the default seed."""

from pathlib import Path

import pytest

from tactuator.paper.plan import Plan, paper_display
from tactuator.paper.publication.publish import publish
from tactuator.paper.run import Study, run_study
from tactuator.paper.speech import check_speech


@pytest.fixture(scope="session")
def study() -> Study:
    plan = Plan(paper_display())
    return run_study(plan, check_speech(plan), lambda step, done: None)


@pytest.fixture(scope="session")
def published(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reproduce") / "paper"
    folder.mkdir()
    publish(study, folder)
    return folder

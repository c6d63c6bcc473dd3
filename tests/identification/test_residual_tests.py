"""The tests of a residual, where the model's slopes are no numbers any more."""

import numpy as np
import pytest

from tactuator.identification.residual_tests import check_residual


@pytest.mark.parametrize("amiss", [np.inf, np.nan, 1e200])
def test_residual__slopes_that_overflow__speak_for_no_model(amiss):
    """Found with a record of a plant that runs away: the eigenvalues of what was no number did not converge."""
    random = np.random.default_rng(1)
    slopes = random.standard_normal((4000, 2))
    slopes[17, 1] = amiss
    with np.errstate(all="ignore"):
        found = check_residual(random.standard_normal(4000), random.standard_normal(4000), slopes, 1000.0)
    assert found.uncorrelated_p == 0.0

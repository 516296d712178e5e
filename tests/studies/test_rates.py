import numpy as np
import pytest

from studies.rates import rate_columns


def test_the_interval_of_a_rate_is_clopper_and_pearsons():
    none = {"rate": 0, "rate_low": 0, "rate_high": pytest.approx(1 - 0.025**0.1)}
    assert rate_columns(0, 10) == none
    assert rate_columns(10, 10)["rate_high"] == 1
    assert rate_columns(5, 10, "seen")["seen"] == 0.5
    assert np.isnan([rate_columns(0, 0)[name] for name in ("rate_low", "rate_high")]).all()

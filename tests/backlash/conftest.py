from unittest.mock import Mock

import pytest

from backlash import estimates
from backlash.answer import Estimate


@pytest.fixture
def examine(monkeypatch):
    """Answers by a log's name, "A10.csv" for 1 mrad, in place of those by its content."""

    def answer(log, settings):
        delta = 1e-4 * int(log.stem[1:])
        return Estimate(
            str(log),
            "backlash",
            backlash_rad=delta,
            backlash_interval_rad=(delta - 1e-5, delta + 1e-5),
            joint={"loss": (0.1, 0.02)},
            notes=("one", "two"),
        )

    mock = Mock(side_effect=answer)
    monkeypatch.setattr(estimates, "examine", mock)
    return mock

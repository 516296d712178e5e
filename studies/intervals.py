"""The interval of one more number."""

from collections.abc import Sequence

import numpy as np

from replication.signature import FloatArray


def prediction_interval(numbers: Sequence[float] | FloatArray) -> tuple[float, float]:
    """Ends between which one more number like these lies with at least 95 %, whatever their law.

    Of N numbers in order, one more lies between the k-th from either end with the probability 1 - 2 k / (N + 1); k is
    the largest that gives 95 %. Infinite where N is too small: below 39.
    """
    ranked = np.sort(numbers)
    k = int((ranked.size + 1) * 0.025 + 1e-9)
    return (float(ranked[k - 1]), float(ranked[-k])) if k else (-np.inf, np.inf)

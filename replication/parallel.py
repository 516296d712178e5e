"""Work on all cores."""

from collections.abc import Callable, Iterable
from typing import Any

from joblib import Parallel, delayed
from tqdm import tqdm


def in_parallel(function: Callable, calls: Iterable[tuple], label: str) -> list[Any]:
    """Results of a function for tuples of arguments, in their order.

    The label stands beside the progress bar.
    """
    work = [delayed(function)(*arguments) for arguments in calls]
    results = Parallel(n_jobs=-1, return_as="generator")(work)
    return list(tqdm(results, total=len(work), desc=label, mininterval=5))

"""Work on all cores."""

from collections.abc import Callable, Iterable
from typing import Any


def in_parallel(function: Callable, calls: Iterable[tuple], label: str) -> list[Any]:
    """Results of a function for tuples of arguments, in their order; the label stands beside the progress bar."""
    from joblib import Parallel, delayed  # slow to import, and most commands work on one core
    from tqdm import tqdm

    work = [delayed(function)(*arguments) for arguments in calls]
    results = Parallel(n_jobs=-1, return_as="generator")(work)
    return list(tqdm(results, total=len(work), desc=label, mininterval=5))

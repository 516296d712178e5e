"""Work on all cores."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any


def one_by_one(function: Callable, calls: Iterable[tuple], label: str) -> Iterator[Any]:
    """Results of a function for tuples of arguments, in their order, each as soon as it is there.

    The label stands beside the progress bar.
    """
    from joblib import Parallel, delayed  # slow to import, and most commands work on one core
    from tqdm import tqdm

    work = [delayed(function)(*arguments) for arguments in calls]
    results = Parallel(n_jobs=-1, return_as="generator")(work)
    yield from tqdm(results, total=len(work), desc=label, mininterval=5)


def in_parallel(function: Callable, calls: Iterable[tuple], label: str) -> list[Any]:
    """Results of a function for tuples of arguments, in their order."""
    return list(one_by_one(function, calls, label))

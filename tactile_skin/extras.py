# SPDX-License-Identifier: Apache-2.0
"""What not every installation has."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

_Item = TypeVar("_Item")
_Found = TypeVar("_Found")


def load(module: str, needs: str, extra: str) -> Any:
    """Return a module; ModuleNotFoundError names the extra of ours that has it."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"{needs}: pip install 'tactile_skin[{extra}]'") from error


def torch():
    """Return PyTorch."""
    return load("torch", "needs PyTorch", "train")


def tqdm():
    """Return the progress bar."""
    return load("tqdm", "long work shows its progress by tqdm", "progress").tqdm


def track(items: Iterable[_Item], total: int | None = None, desc: str = "") -> Iterable[_Item]:
    """Return the items, with a progress bar where tqdm is installed."""
    try:
        bar = tqdm()
    except ModuleNotFoundError:
        return items
    followed: Iterable[_Item] = bar(items, desc=desc, total=total, disable=None, leave=False)
    return followed


def each(
    function: Callable[[_Item], _Found], items: Iterable[_Item], jobs: int = 1
) -> Iterable[_Found]:
    """Return function(item) of each item, in their order: in a loop, or by joblib.

    joblib's backend is the caller's choice: `with joblib.parallel_config("dask"):` a cluster works.

    Args:
        function: at the top of a module, for other processes find it by its name.
        jobs: processes; 1: those of joblib's `parallel_config`, or this one where there is none.

    Raises:
        ValueError: jobs below 1.
        ModuleNotFoundError: several processes, and joblib is not installed.
    """
    if jobs < 1:
        raise ValueError(f"jobs = {jobs}: must be 1 or more")
    if jobs == 1 and "joblib" not in sys.modules:  # nobody can have configured it
        return map(function, items)
    joblib = load("joblib", f"{jobs} processes need joblib", "record")
    work = joblib.Parallel(n_jobs=None if jobs == 1 else jobs)
    found: Iterable[_Found] = work(joblib.delayed(function)(item) for item in items)
    return found

# SPDX-License-Identifier: Apache-2.0
"""Leave out a mechanism, to see what it is worth: what costs no figure goes."""

from __future__ import annotations

import pkgutil
import sys
from functools import partial

from tactile_skin.health import monitor
from tactile_skin.health.check import Check


def playing(play, names: list[str]):
    """Return `play`, or what plays without the mechanisms of these names, in any process."""
    return partial(_left_out, play=play, names=names) if names else play


def _left_out(task, play, names: list[str]):
    for name in names:
        leave_out(name)
    return play(task)


def mechanism(name: str):
    """Return a check, or a function that may return None, by its name within the package.

    Raises:
        ValueError: there is no such thing, or nothing that can be left out.
    """
    try:
        found = pkgutil.resolve_name(f"tactile_skin.{name}")
    except (ImportError, AttributeError) as error:
        raise ValueError(f"--without {name}: {error}") from None
    if found is _nothing or (isinstance(found, type) and issubclass(found, Check)):
        return found
    if "None" not in str(getattr(found, "__annotations__", {}).get("return")):
        raise ValueError(f"--without {name}: no check, and no function that may return None")
    return found


def leave_out(name: str) -> None:
    """Leave a check out of those that run; let a function return None wherever it is called."""
    found = mechanism(name)
    if isinstance(found, type):
        monitor.CHECKS[:] = [check for check in monitor.CHECKS if check is not found]
        return
    holders = [m for n, m in sys.modules.items() if n.partition(".")[0] == "tactile_skin"]
    holders.append(pkgutil.resolve_name(f"tactile_skin.{name.rpartition('.')[0]}"))
    for holder in holders:
        for attribute, value in list(vars(holder).items()):
            if value is found:
                setattr(holder, attribute, _nothing)


def _nothing(*_arguments, **_named) -> None:
    """Find nothing."""

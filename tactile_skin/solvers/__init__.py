# SPDX-License-Identifier: Apache-2.0
"""From a reading to the force on each cell: one entry, `compensate`, and a file per method.

reading.py      one checked frame           estimate.py   what comes out
fixed_point.py  the literature's iteration, and the paper's naive method
learned.py      the networks                newton.py     the exact inverse
map.py          noise-aware, with prior.py  auto.py       the cheapest that the frame allows
suspect.py      tests of the circuit model  evidence.py   of what lies in series
aside.py        without bad contacts        fit.py        from a fit to forces, and levels of lines
"""

from __future__ import annotations

import inspect
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..learning import network
from ..physics import lines
from ..physics.circuit import Circuit
from ..physics.curve import PressureCurve
from .auto import auto
from .estimate import Estimate, batch_of, check_start
from .fixed_point import first_guess, fixed_point, iterate, last_guess, naive
from .learned import cnn, physics
from .map import map_estimate
from .newton import newton
from .reading import Reading, check_reading
from .suspect import EXACT_NOISE, no_convergence

METHODS = {
    "naive": naive,
    "fixed_point": fixed_point,
    "newton": newton,
    "map": map_estimate,
    "cnn": cnn,
    "physics": physics,
    "auto": auto,
}

# Arguments of each method beside the reading. `start` is allowed with all: a stream passes it on
# whatever its method.
_TAKES = {name: tuple(inspect.signature(m).parameters)[1:] for name, m in METHODS.items()}
_LIGHT = "fixed_point", "newton"  # of two pictures that fit alike they find the lighter one only
_GUESS = 4, 8  # steps of the fixed point by which what the stripes add is first guessed
_LEAST_SHARE = 0.1  # of a change, that is taken,
_MOST_SHARE = 2.0  # and at most
_ROUNDS = 20  # fits at most
_CLOSE = 0.3  # standard deviations by which what the stripes add may still change
_EXACT = 1e-6  # ADC steps by which it may then still change of exact readings, if rounds are left

__all__ = ["METHODS", "Estimate", "check_reading", "compensate"]


def compensate(
    adc,
    circuit: Circuit,
    curve: PressureCurve,
    method: str = "auto",
    *,
    weights=None,
    start: Estimate | None = None,
    noise=None,
    missing: bool = False,
    threshold: float = 0.0,
    ceiling: float = 1.0,
    time_limit: float | None = None,
    hurry: bool = False,
) -> Estimate:
    """Undo the cross-talk of one frame, or of each of a batch.

    Args:
        adc: (rows, cols) reading as ADC ratio, in [0, 1], or (n, rows, cols) of n frames, each on
            its own. Where the circuit has no cell, NaN says that the crossing was not read.
        method: "naive" (paper section V: each reading taken for its own cell), "fixed_point" (the
            literature's g <- g * rho(g) / rho_measured), "newton" (the exact inverse), "map"
            (least squares in ADC steps with a prior), "cnn" (the paper's network), "physics" (one
            that is fed with the circuit's physics), or "auto" (the cheapest that the frame
            allows; `Estimate.method` names it, "rest" if nothing touches). Where a light picture
            and a hard one may fit alike, "map" stands for "fixed_point" and "newton", too.
        weights: for cnn and physics, a `network.Weights` or the file of one, as a node's; None:
            those of the package.
        start: the last frame's estimate, from which newton, map and auto then go on, and which the
            others ignore; every frame of a batch goes on from it.
        noise: RMS noise of a reading [ADC steps]; 0: exact. None: map and auto measure it in the
            frame, the others assume that of rounding to whole steps.
        missing: whether NaN marks a missing reading (map and auto only).
        threshold: ADC ratio of the board's threshold: a reading at or below it is only known not
            to be above (map and auto only).
        time_limit: seconds after which an iteration gives up on a frame; its last estimate is
            "failed".
        hurry: whether `auto` is to take `fixed_point` for what touches; the others ignore it.

    Returns:
        The estimate, of a batch with a leading axis: force and std (n, rows, cols), all else (n,).

    Raises:
        ValueError: wrong shape, NaN where a reading is due, a reading outside [0, 1], an argument
            of another type or outside its range, an unknown method, an argument that the method
            does not use, a method that needs what is missing, or weights that were made for another
            circuit or curve. Of a batch, the message names the frame.
    """
    if method not in METHODS:
        raise ValueError(f"method {method!r}: must be one of {', '.join(METHODS)}")
    given = {"weights": weights, "start": start, "hurry": hurry}
    if weights is not None and "weights" not in _TAKES[method]:
        users = " and ".join(m for m, takes in _TAKES.items() if "weights" in takes)
        raise ValueError(f"method {method!r} does not use weights: only {users} do")
    if isinstance(weights, (str, Path)):
        given["weights"] = network.load(weights)
    if start is not None:
        check_start(start, circuit)
    given = {name: given[name] for name in _TAKES[method]}
    checks: dict[str, Any] = {"missing": missing, "threshold": threshold, "ceiling": ceiling}
    checks |= {"noise": noise, "time_limit": time_limit}
    adc = np.asarray(adc, dtype=float)
    if adc.ndim != 3:
        return _one(check_reading(adc, circuit, curve, **checks), method, given)
    estimates = []
    for k, frame in enumerate(adc):
        try:
            estimates.append(_one(check_reading(frame, circuit, curve, **checks), method, given))
        except ValueError as error:
            raise ValueError(f"frame {k} of {len(adc)}: {error}") from error
    return batch_of(estimates, circuit.shape)


def _one(reading: Reading, method: str, given: dict) -> Estimate:
    """One frame by one method, with the arguments that it takes.

    The methods know stripes without resistance. What these add depends little on the picture: it is
    taken from a guess, and from the estimate until it stays.
    """
    stripes = reading.circuit.stripes
    if method in _LIGHT and reading.may_fit_two and reading.all_cells_read:
        method, given = "map", {"start": given.get("start")}
    solve = METHODS[method]
    if stripes is None or method == "naive":
        return solve(reading, **given)
    ideal = replace(reading, circuit=replace(reading.circuit, r_line=0.0))
    exact, close = reading.noise == 0.0, _CLOSE * (reading.noise or EXACT_NOISE)
    start = given.get("start")
    if start is not None:
        g = last_guess(ideal, start)
    else:
        g = first_guess(ideal)
        for steps in _GUESS:
            behind = ideal.behind(lines.added(g, stripes, exact))
            g = iterate(behind, first_guess(behind), steps, 0.0)[0]
    added, share, last = lines.added(g, stripes, exact), 1.0, None
    for _ in range(_ROUNDS):
        behind = ideal.behind(added)
        estimate = solve(behind, **given)
        now = lines.added(last_guess(ideal, estimate), stripes, exact)
        change = np.abs(behind.adc - ideal.behind(now).adc).max() * ideal.circuit.full_scale
        if change <= (_EXACT if exact else close) or reading.late():
            break
        off = now - added
        if last is not None:  # Aitken: cells that their readings hardly determine swing
            turn = off - last
            share = np.clip(
                -share * (last * turn).sum() / np.square(turn).sum(), _LEAST_SHARE, _MOST_SHARE
            )
        added, last = np.maximum(added + share * off, 0.0), off
    if change > close and estimate.status == "ok":
        why = no_convergence(reading, int(estimate.iterations))
        estimate = replace(estimate, status="failed", message=why)
    return estimate

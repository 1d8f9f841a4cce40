"""What is wrong with the arguments of `compensate` beside the reading: ValueError says where."""

from __future__ import annotations

import numpy as np

from ..files import shorten
from ..physics.circuit import Circuit
from .estimate import Estimate

# Of a prior [N]; the squares of both stay numbers.
_MAX_PRIOR_MEAN = 1e6  # no cell feels more
_MIN_PRIOR_STD = 1e-6  # none is known better


def check_start(start: Estimate, circuit: Circuit) -> None:
    """ValueError unless `start` is an estimate to go on from, of a skin of this shape."""
    if not isinstance(start, Estimate):
        kind = type(start).__name__
        raise ValueError(f"start is of type {kind}: must be an Estimate, that of the last frame")
    force = np.asarray(start.force)
    if force.shape != circuit.shape:
        raise ValueError(f"start has shape {force.shape}: the circuit is {circuit.shape}")
    if not (force.min() >= 0.0 and force.max() < np.inf):  # NaN is neither
        _refuse("start.force", force, (force >= 0.0) & (force < np.inf), "finite and 0 N or more")


def check_prior(prior, circuit: Circuit) -> tuple[np.ndarray, np.ndarray]:
    """(mean, std) as (rows, cols) arrays [N]; ValueError says what is wrong with them, and where.

    Where the circuit has no cell, anything is allowed.
    """
    try:
        mean, std = prior
    except (TypeError, ValueError) as error:
        raise ValueError(f"prior = {shorten(prior)}: must be two, mean and std") from error
    mean, std = _picture("prior mean", mean, circuit), _picture("prior std", std, circuit)
    known = (mean >= 0.0) & (mean <= _MAX_PRIOR_MEAN)
    if not known.all():
        _refuse("prior mean", mean, known, f"from 0 to {_MAX_PRIOR_MEAN:g} N")
    if not (std > 0.0).all():
        _refuse("prior std", std, std > 0.0, "above 0 N")
    return mean, np.maximum(std, _MIN_PRIOR_STD)


def uneven_noise(noise, circuit: Circuit) -> tuple[float, np.ndarray]:
    """Return the usual noise [ADC steps], and (rows, cols) how many times it each reading has."""
    noise = _picture("noise", noise, circuit)
    good = (noise > 0.0) & (noise < circuit.full_scale)
    if not good.all():
        _refuse("noise", noise, good, "above 0 ADC steps, below full scale")
    usual = float(np.median(noise[circuit.populated]))
    return usual, np.maximum(noise / usual, 1.0)


def _picture(name: str, value, circuit: Circuit) -> np.ndarray:
    """Return a number or (rows, cols) as (rows, cols) floats, 1 where there is no cell."""
    try:
        array = np.asarray(value)
    except ValueError:  # lists of unequal length
        array = np.array(None)
    if array.dtype.kind not in "fiu":
        kind = type(value).__name__
        raise ValueError(f"{name} is of type {kind}: must be a number or {circuit.shape} of them")
    if array.shape not in ((), circuit.shape):
        raise ValueError(f"{name} has shape {array.shape}: must be a number or {circuit.shape}")
    return np.where(circuit.populated, array, 1.0)


def _refuse(name: str, array: np.ndarray, good: np.ndarray, allowed: str):
    row, col = np.argwhere(~good)[0]
    raise ValueError(f"{name} = {array[row, col]} at row {row}, column {col}: must be {allowed}")

# SPDX-License-Identifier: Apache-2.0
"""One known weight, before work: a factor on a curve that is there, and the proof of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .. import __version__
from ..calibration import proving
from ..calibration.creep import as_it_comes
from ..middleware.config import SkinConfig
from ..middleware.written import entered, replace_file
from ..physics.creep import Creep
from ..physics.proof import NOTHING
from .calibrated import entries_of, points
from .calibration import Guide

PRESSES = 3  # that run the fabric in
_MOST = 12  # presses until r_par must have shown
_TRIES = 5  # to lay the weight on


def measure_gain(guide: Guide, weight: float, skin: SkinConfig) -> float:
    """Lead through three presses and one weight [N]; return the factor on the curve.

    Raises:
        ValueError: the weight proves nothing; the message says what to do.
    """
    guide.measure_rest()
    _press(guide, f"2 of 3. Press hard with a fist at {PRESSES} places, each for a moment.")
    frame = _laid(guide, weight)
    stands = as_it_comes(skin.curve, Creep(), skin.creep)
    used = proving.Tried(skin.circuit, guide.rest, stands, np.empty(0))
    proved = skin.proof.by != NOTHING
    known = proving.Known(
        skin.proof.error if proved else None,
        skin.r_par_std if proved and skin.r_par_std is not None else np.inf,
    )
    while True:
        found = proving.by_one_weight(used, frame, weight, guide.touches, known, guide.pitch)
        if not found.more or len(guide.touches) >= _MOST:
            break
        if not _press(guide, f"  Take it off. r_par has not shown yet: {PRESSES} more places."):
            break
    if found.why:
        raise ValueError(f"not proved: {found.why}")
    guide.conclude(found.error, "", [weight])
    return found.factor


def _press(guide: Guide, what: str) -> int:
    """Ask for some presses; how many counted."""
    guide.say(what)
    counted = 0
    for counted, _ in enumerate(guide.presses(), 1):
        guide.say(f"  press {counted}")
        if counted == PRESSES:
            break
    return counted


def _laid(guide: Guide, weight: float) -> np.ndarray:
    """Return the mean frame of the weight [N], once it stands."""
    for _ in range(_TRIES):
        guide.ask(
            f"3 of 3. Lay the weight of {weight:.4g} N anywhere on the skin, on foam if it is\n"
            "  hard. Enter once it lies: "
        )
        if (frame := guide.weighed(f"{weight:.4g} N")) is not None:
            return frame
    raise ValueError(f"nothing stood on the skin in {_TRIES} tries: no factor is written")


def write_gain(
    path: Path, source: Path | None, guide: Guide, factor: float, skin: SkinConfig
) -> None:
    """Write the configuration with the factor and its proof; all other entries stay.

    A curve that a factor below 1 makes end early goes on as it ends.
    """
    gain = np.ones(skin.circuit.shape) if skin.curve.gain is None else skin.curve.gain
    alike = bool((gain == gain.flat[0]).all())
    curve = proving.times(skin.curve, factor, skin.circuit.shape)
    changes = points(curve) if len(curve.points) > len(skin.curve.points) else {}
    scaled = (gain.ravel()[:1] if alike else gain.ravel()) * factor
    changes |= {"gain": scaled.round(4).tolist()} | entries_of(guide.proof)
    note = (
        f"gain times {factor:.3f} by tactile-skin calibrate --gain {__version__}, "
        f"{guide.proof.date:%Y-%m-%d}"
    )
    replace_file(path, entered(source, {"curve": changes}, [note], keep=True))

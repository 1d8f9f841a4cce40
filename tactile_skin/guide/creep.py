# SPDX-License-Identifier: Apache-2.0
"""How a person is led through the creep of a fabric: five presses, or one thing that stands."""

from __future__ import annotations

import numpy as np

from ..calibration.creep import creep_of_presses, measure_creep
from ..calibration.rest import supposing
from ..physics.curve import PressureCurve
from .calibration import BACK, PATIENCE, Guide, mean_of

PRESSES = 60.0  # s in which a thing is laid on and taken off five times
STANDS = 120.0  # s for which a thing stands to show how much it gains
_LOOK = 0.25  # s of which each frame of it is the mean
_WORD = 10.0  # s after which a word is said


def find_creep(guide: Guide) -> bool:
    """Find creep by five presses, if somebody wants to; False: a step back is asked for."""
    word = guide.ask(
        "Creep, if you like: within a minute lay one of the things on five times: down in a "
        "second, five\n  seconds there, off. p: begin; b: back; Enter: end without it: "
    )
    if word.strip() != "p" or not guide.fitted:
        return word.strip() not in BACK
    frames = guide.straight(guide.frames(PRESSES))
    times = np.arange(len(frames)) * PRESSES / max(len(frames), 1)
    rest = supposing(guide.at_rest, guide.circuit)
    try:
        creep = creep_of_presses(frames, times, guide.circuit, rest, guide.fitted.curve)
    except ValueError as error:
        guide.say(f"  {error}")
        return True
    guide.creep = creep
    guide.say(f"  A load gains {creep.share:.0%} +- {creep.std:.0%} in a decade of time.")
    return True


def stand(guide: Guide, curve: PressureCurve) -> None:
    """Lead through two steps of their own, for a skin whose curve is known.

    Raises:
        ValueError: nothing was laid on the skin, or what it shows is no creep.
    """
    guide.measure_rest(of=2)
    guide.ask(
        "2 of 2. Take a thing of 1 kg or more, and a piece of foam if it is hard. Enter, and "
        f"lay it on the\n  skin at once; leave it there for {STANDS / 60:.0f} minutes: "
    )
    frames: list[np.ndarray] = []
    stood = 0.0  # s
    while stood <= STANDS:
        frames.append(mean_of(guide.frames(_LOOK)))
        if stood or guide.touched(frames[-1]):
            stood += _LOOK
            if stood % _WORD == 0.0:
                guide.say(f"  {stood:.0f} s of {STANDS:.0f} s")
        elif len(frames) * _LOOK > PATIENCE:
            raise ValueError(f"nothing was laid on the skin for {PATIENCE:.0f} s")
    times = _LOOK * (np.arange(len(frames)) + 0.5)
    creep = measure_creep(np.array(frames), times, guide.supposed, guide.rest, curve)
    guide.creep = creep
    guide.say(
        f"  A standing load gains {creep.share:.1%} +- {creep.std:.1%} in a decade "
        f"of time: {creep.gain(600.0) - 1.0:.0%} in ten minutes."
    )

# SPDX-License-Identifier: Apache-2.0
"""Frames as checks of a running skin take them."""

from types import SimpleNamespace

import numpy as np

from tactile_skin.health.check import Seen, Windows


def seen(t=0.0, *, force=None, aside=None, samples=None, adc=None, rest=None, noise=0.0, **more):
    """Return a frame with what is given; samples are taken as rising."""
    given = next(picture for picture in (force, samples, adc) if picture is not None)
    force = np.zeros(np.shape(given)) if force is None else force
    estimate = SimpleNamespace(force=force, aside=aside, status="ok", message="")
    more = {"stirs": False, "window": None} | more
    return Seen(t, samples, samples, adc, estimate, rest=rest, noise=noise, **more)


class Samples:
    """Feeds a check with samples, and with windows of them."""

    def __init__(self, check, bits: int):
        self.check, self._windows = check, Windows(bits)

    def frame(self, samples, rest=None) -> str:
        self.check.frame(seen(samples=samples, rest=rest, window=self._windows.frame(samples)))
        return said(self.check)


def said(check) -> str:
    """Return what a check finds, in words."""
    return "; ".join(map(str, check.findings()))

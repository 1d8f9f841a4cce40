# SPDX-License-Identifier: Apache-2.0
"""An object whose weight is told must lie on the skin all the while it is measured."""

from types import SimpleNamespace

import numpy as np

from tactile_skin import Circuit
from tactile_skin.guide.calibration import Guide


def test_frames_before_the_object_came_or_slid_are_seen():
    guide = Guide(Circuit(rows=4, cols=4), lambda s: None, lambda q: "", lambda t: None)
    guide._rest = SimpleNamespace(adc=np.full((4, 4), 0.1), noise=1.0)
    noise = np.random.default_rng(0).normal(0.0, 0.001, (90, 4, 4))
    stands = 0.1 + noise
    stands[:, 1:3, 1:3] += 0.3
    came = stands.copy()
    came[:50, 1:3, 1:3] -= 0.3
    slid = stands.copy()
    slid[45:, 1:3, 1] -= 0.05
    assert guide.stands(stands)
    assert not guide.stands(came)
    assert not guide.stands(slid)

# SPDX-License-Identifier: Apache-2.0
"""A touch that stands without moving says what it may be, and stops nothing by itself."""

import numpy as np
from health.seen import said, seen

from tactile_skin import Circuit
from tactile_skin.behaviours.stop import StopConfig, StopPolicy
from tactile_skin.health.standing import Standing
from tactile_skin.physics.adc import Adc

WET = np.zeros((4, 4))
WET[1, 1:3] = 4.8  # N


def played(pictures, every=0.5):
    """What is said after each force picture."""
    check, texts = Standing(Adc(Circuit(4, 4))), []
    for k, force in enumerate(pictures):
        check.frame(seen(every * k, force=force))
        assert not any(f.stops for f in check.findings())
        texts.append(said(check))
    return texts


def test_one_that_is_there_from_the_start_is_named_soon():
    texts = played([0.0 * WET] * 3 + [WET] * 60)
    assert not any(texts[:20]) and "9.6 N stand there without moving, since the start" in texts[-1]
    assert "wet" in texts[-1] and "strap" in texts[-1] and "bit" in texts[-1]


def test_one_that_comes_later_is_named_after_minutes_also_while_it_creeps():
    texts = played([0.0 * WET] * 100 + [WET * (1.0 + 0.001 * k) for k in range(260)])
    assert not any(texts[:330]) and "for 120 s" in texts[-1]


def test_hands_that_work_are_not():
    rng = np.random.default_rng(1)
    assert not any(played([WET * rng.uniform(0.0, 2.0) for _ in range(600)]))


def test_it_is_over_when_it_is_gone():
    texts = played([WET] * 60 + [0.0 * WET] * 4)
    assert texts[59] and not texts[-1]


def test_a_push_by_it_is_named_so():
    policy = StopPolicy(StopConfig())
    policy.stands = "row 1, column 1: stands. Is the fabric wet?"
    for k in range(20):
        decision = policy.reading(0.01 * k, 40.0)
    assert decision.stop and decision.reason.endswith(
        "limit 30 N; row 1, column 1: stands. Is the fabric wet?"
    )

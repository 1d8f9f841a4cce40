"""Exchanged lines are told by the touches, and sound boards' are not."""

import numpy as np
import pytest

from tactile_skin.bench.damage.streams import everyday
from tactile_skin.calibration.watch.order import Order
from tactile_skin.learning import scenes

MOST = 9.8  # N on a cell


def told(frames):
    """Touches before each message of the order's watch, and the last message."""
    order, after, message = Order(), [], ""
    for touches, frame in enumerate(frames):
        order.frame(frame)
        order.frame(np.zeros_like(frame))
        message = order.message
        after += [touches + 1] if message else []
    return after, message


def everyday_touches(shape, seconds, rng):
    """(touches, rows, cols) [N]: each at its strongest, as it is found within 5 %."""
    force = everyday(np.ones(shape, bool), seconds, rng, MOST, hard=False).force
    total = force.sum((1, 2))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], total > 1.0, [0]])))
    strongest = [a + int(total[a:b].argmax()) for a, b in edges.reshape(-1, 2)]
    return force[strongest] * np.exp(0.05 * rng.standard_normal((len(strongest), *shape)))


@pytest.mark.parametrize("shape", [(3, 20), (8, 8), (8, 16), (16, 16)])
def test_touches_tell_exchanged_lines_and_no_others(shape):
    """The thresholds were chosen on other touches (seeds 57050 to 57053)."""
    right, after = [], []
    for seed in range(8):
        rng = np.random.default_rng([57040, seed, *shape])
        touches = everyday_touches(shape, 80.0, rng)
        assert told(touches)[0] == [], "a sound board"
        axis = int(rng.integers(2)) if min(shape) > 3 else 1
        a, b = sorted(rng.permutation(shape[axis])[:2])
        order = np.arange(shape[axis])
        order[[a, b]] = b, a
        said, message = told(np.take(touches, order, axis=axis + 1))
        after.append(said[0] if said else np.inf)
        right.append(message.startswith(f"{('rows', 'columns')[axis]} {a} and {b} "))
    assert np.median(after) <= 20
    assert np.mean(right) >= 0.75  # on few lines another order may be as smooth


def two_fingers(rng, shape):
    """A grip: two fingers at one distance, anywhere."""
    row, col = rng.uniform(1.0, shape[0] - 2.0), rng.uniform(1.0, shape[1] - 5.0)
    one, other = (scenes.finger(*shape, row, c, rng.uniform(2, 20), 0.8) for c in (col, col + 3.0))
    return one + other


def same_place(rng, shape):
    """One thing that is put down in one place again and again, on two feet."""
    feet = scenes.finger(*shape, 2.0, 1.5, 5.0, 0.7) + scenes.finger(*shape, 2.0, 5.5, 5.0, 0.7)
    return rng.uniform(0.5, 2.0) * feet * np.exp(0.1 * rng.standard_normal(shape))


def alone(rng, shape):
    """Single cells, as of a stylus."""
    picture = np.zeros(shape)
    picture[tuple(rng.integers(shape))] = rng.uniform(0.5, 8.0)
    return picture


@pytest.mark.parametrize("kind", [two_fingers, same_place, alone])
@pytest.mark.parametrize("shape", [(4, 8), (8, 8), (16, 16)])
def test_touches_that_are_torn_by_themselves_tell_nothing(kind, shape):
    for seed in range(8):
        rng = np.random.default_rng([57041, seed, *shape])
        assert told([kind(rng, shape) for _ in range(40)])[0] == []


def test_what_was_mended_is_forgotten():
    """By the touches that follow, without a reset."""
    rng = np.random.default_rng([57042, 0])
    touches = everyday_touches((8, 8), 120.0, rng)
    order = [0, 5, 2, 3, 4, 1, 6, 7]
    said, message = told([*touches[:20][:, :, order], *touches[20:]])
    assert said and said[0] <= 20 and not message

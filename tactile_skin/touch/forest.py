"""A forest of decision trees as plain numbers: it is trained elsewhere, and asked here.

All trees are descended at once, a level a step, so that an answer of 100 trees takes a fraction of
a millisecond in NumPy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_LEAF = -1


class Forest(NamedTuple):
    """Trees of which each node asks whether a feature is at most a threshold.

    Attributes:
        feature: (nodes,) int, what a node asks for; -1 in a leaf.
        threshold: (nodes,) float.
        below: (nodes,) int, the node that follows where the feature is at most the threshold.
        above: (nodes,) int, the other.
        share: (nodes, classes) float, share of each class in a leaf; 0 in other nodes.
        roots: (trees,) int.
    """

    feature: np.ndarray
    threshold: np.ndarray
    below: np.ndarray
    above: np.ndarray
    share: np.ndarray
    roots: np.ndarray

    def shares(self, features: np.ndarray) -> np.ndarray:
        """Return the mean share of each class in the leaves that the features fall into.

        Args:
            features: (n,).

        Returns:
            (classes,), of sum 1.
        """
        node = self.roots
        while True:
            asked = self.feature[node]
            inner = asked != _LEAF
            if not inner.any():
                return np.asarray(self.share[node].mean(0))
            step = np.where(
                features[asked] <= self.threshold[node], self.below[node], self.above[node]
            )
            node = np.where(inner, step, node)

    def check(self, features: int) -> None:
        """Raise ValueError where the numbers are no forest of so many features.

        Each node comes before those that follow it, so that every descent ends.
        """
        nodes = len(self.feature)
        inner = self.feature != _LEAF
        ahead = np.arange(nodes)
        sound = (
            all(len(part) == nodes for part in (self.threshold, self.below, self.above, self.share))
            and nodes > 0
            and len(self.roots) > 0
            and ((self.roots >= 0) & (self.roots < nodes)).all()
            and ((self.feature >= _LEAF) & (self.feature < features)).all()
            and all(
                ((part > ahead) & (part < nodes))[inner].all() for part in (self.below, self.above)
            )
            and np.isfinite(self.threshold[inner]).all()
            and (self.share >= 0.0).all()
            and np.allclose(self.share[~inner].sum(1), 1.0, atol=0.02)
        )
        if not sound:
            raise ValueError("the trees are damaged: their nodes do not form a forest")

# SPDX-License-Identifier: Apache-2.0
"""What a recogniser has learnt: its classes, a forest and a line, in a file of plain numbers.

A forest sees what belongs together, a logistic regression what adds up; of people that neither has
seen their common opinion is right more often than either's.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from . import stored
from .episode import FEATURES

OTHER = "other"  # what is no gesture that the model knows
VERSION = 1  # of the file
CLIP = 4.0  # standard deviations: a feature far out says no more
TREES_SAY = 0.7  # weight of the forest: chosen on two people's real gestures, the other's left out
_LEAST = 1e-6  # share of a class that no tree has seen there
_LEAF = -1  # no feature is asked for


class Forest(NamedTuple):
    """Trees of which each node asks whether a feature is at most a threshold."""

    feature: np.ndarray  # (nodes,) int, what a node asks for; -1 in a leaf
    threshold: np.ndarray  # (nodes,) float
    # (nodes,) int, the node that follows where the feature is at most the threshold
    below: np.ndarray
    above: np.ndarray  # (nodes,) int, the other
    share: np.ndarray  # (nodes, classes) float, share of each class in a leaf; 0 in other nodes
    roots: np.ndarray  # (trees,) int

    def shares(self, features: np.ndarray) -> np.ndarray:
        """Return the mean share (classes,) of each class in the leaves of features (n,)."""
        # all trees are descended at once, a level a step
        node, left = self.roots, []
        while node.size:
            asked = self.feature[node]
            inner = asked != _LEAF
            left.append(node[~inner])
            node, asked = node[inner], asked[inner]
            below = features[asked] <= self.threshold[node]
            node = np.where(below, self.below[node], self.above[node])
        return np.asarray(self.share[np.concatenate(left)].mean(0))


class Logistic(NamedTuple):
    """A multinomial logistic regression."""

    # mean, scale: (n,) of the features; they are clipped to CLIP scales
    mean: np.ndarray
    scale: np.ndarray
    weights: np.ndarray  # (classes, n)
    bias: np.ndarray  # (classes,)

    def shares(self, features: np.ndarray) -> np.ndarray:
        """Return the probability of each class (..., classes) of features (..., n)."""
        z = np.clip((features - self.mean) / self.scale, -CLIP, CLIP)
        score = z @ self.weights.T + self.bias
        raised = np.exp(score - score.max(-1, keepdims=True))
        return np.asarray(raised / raised.sum(-1, keepdims=True))


class GestureModel(NamedTuple):
    """Names gestures by their features."""

    classes: tuple[str, ...]  # names, in the order of the probabilities
    forest: Forest  # over `episode.FEATURES`
    logistic: Logistic  # over the same features
    # exponent that makes their shares probabilities: of people left out it is as sure on average as
    # it is right
    sharpness: float
    about: dict[str, Any]  # what it was trained on: people, takes a class, boards, date

    def probabilities(self, features: np.ndarray) -> np.ndarray:
        """Return the probability of each class, by the (n,) features of an `Episode`."""
        both = common(self.forest.shares(features), self.logistic.shares(features))
        return sharpened(both, self.sharpness)

    def save(self, path: str | Path) -> None:
        """Write the model to an .npz file of plain numbers."""
        head = {"version": VERSION, "classes": self.classes, "features": FEATURES}
        head |= {"sharpness": self.sharpness, "about": self.about}
        small = self.forest._replace(share=self.forest.share.astype(np.float16))
        stored.save(path, head, small._asdict() | self.logistic._asdict())


def common(trees: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Return the common opinion (..., classes) of a forest and a regression: a geometric mean."""
    both = np.maximum(trees, _LEAST) ** TREES_SAY * np.maximum(line, _LEAST) ** (1.0 - TREES_SAY)
    return np.asarray(both / both.sum(-1, keepdims=True))


def sharpened(shares: np.ndarray, sharpness: float) -> np.ndarray:
    """Return probabilities of trees' shares (..., classes), which are cautious."""
    raised = np.maximum(shares, _LEAST) ** sharpness
    return np.asarray(raised / raised.sum(-1, keepdims=True))


def load_model(path: str | Path) -> GestureModel:
    """Read a model.

    Raises:
        FileError: the file is absent, damaged, or of other features than this version's.
    """
    with stored.load(path, "gesture model") as (head, arrays):
        if head["version"] != VERSION or tuple(head["features"]) != FEATURES:
            raise ValueError(
                "trained by another version, on other features: train it again with "
                "'tactile-skin gestures train'"
            )
        forest = Forest(*(arrays[name] for name in Forest._fields))
        logistic = Logistic(*(np.asarray(arrays[name], float) for name in Logistic._fields))
        share = forest.share.astype(float)
        return GestureModel(
            tuple(map(str, head["classes"])),
            forest._replace(share=share),
            logistic,
            float(head["sharpness"]),
            head["about"],
        )

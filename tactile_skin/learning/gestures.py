# SPDX-License-Identifier: Apache-2.0
"""Trains a recogniser of gestures from takes: recordings of one gesture each, by name and person.

Needs scikit-learn (the extra `gestures`); what it makes runs without.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from ..extras import each
from ..touch.episode import FEATURES, SILENCE
from ..touch.model import CLIP, OTHER, Forest, GestureModel, Logistic, common, sharpened
from ..touch.recogniser import ENDED, REACH, Gathering, Ongoing
from ..touch.take import Take

# s of a gesture after which it is learnt as well: a decision need not wait for its end
GLANCES = (0.12, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.5)
TREES = 60  # more change no figure by its standard error
LEAF = 2  # takes in a leaf at least,
LEAF_SHARE = 1 / 400  # and at least this share of them: many takes make no larger file
CHOICE = 0.3  # share of the features that a node may choose from (as in the study of docs/gestures)
STRONGER = 0.3  # std of the logarithm of force: people press harder or lighter than those recorded
COPIES = 3  # of each take, with other forces
FOLDS = 4  # groups of people that are left out in turn, to see how sure the trees may be
OTHER_COUNTS = 2.0  # times a gesture: there are more kinds of it; chosen on one real person
FREEDOM = 0.3  # inverse of the penalty on the regression's weights
_STEADY = 1e-6  # added to the std of a feature that does not vary
_NEVER = -50.0  # score of a class that a fit has not seen
_SHARPNESS = (0.3, 8.0)  # least and most
_LOGARITHMS_OF_FORCE = (
    *("force_mean", "force_max", "peak_mean", "peak_max", "pressure"),
    *("rise", "fall", "change"),
)


class Takes(NamedTuple):
    """Features of many takes, some times into each and at its end."""

    features: np.ndarray  # (rows, len(FEATURES))
    label: np.ndarray  # (rows,) str
    person: np.ndarray  # (rows,) str
    weight: np.ndarray  # (rows,); those of a take sum to 2, half of them its ends'
    end: np.ndarray  # (rows,) bool: the gesture that has most of the take's force is over
    take: np.ndarray  # (rows,) int


class Glances(NamedTuple):
    """What one of a take's gestures looks like: a recogniser may see several in one take."""

    early: list[np.ndarray]  # features at GLANCES
    last: np.ndarray  # features at its end
    share: float  # of the take's impulse


def table_of(takes: Sequence[Take], reach: float = REACH, track=iter, jobs: int = 1) -> Takes:
    """Return the features of takes; those without a touch are left out.

    Args:
        reach: touches within it of each other are one gesture [m]: large, and two hands are one.
        track: wraps the takes, for a progress bar.
        jobs: processes, as of `extras.each`.
    """
    features, where, weight, end = [], [], [], []
    of_each = each(functools.partial(glances, reach=reach), track(takes), jobs)
    for number, found in enumerate(of_each):
        for k, seen in enumerate(found):
            features += [*seen.early, seen.last]
            where += [number] * (len(seen.early) + 1)
            weight += [seen.share / max(len(seen.early), 1)] * len(seen.early) + [seen.share]
            end += [False] * len(seen.early) + [k == 0]
    return Takes(
        np.array(features).reshape(-1, len(FEATURES)),
        np.array([takes[k].label for k in where], object).astype(str),
        np.array([takes[k].person for k in where], object).astype(str),
        np.array(weight),
        np.array(end, bool),
        np.array(where, int),
    )


def glances(take: Take, reach: float = REACH) -> list[Glances]:
    """Return what a recogniser sees of a take, its hardest gesture first; of no touch nothing."""
    gathering, nothing = Gathering(take.pitch, reach), np.zeros(take.pictures.shape[1:])
    silence = [nothing] * (math.ceil(SILENCE / take.period) + 1)
    gathering.update(0.0, nothing)
    early: dict[int, list[np.ndarray]] = {}
    ended: list[Ongoing] = []
    for k, picture in enumerate([*take.pictures, *silence], 1):
        for gesture in gathering.update(k * take.period, picture):
            rows = early.setdefault(gesture.id, [])
            due = GLANCES[len(rows) :]
            if due and gesture.episode.duration >= due[0] - take.period / 2 and gesture.force:
                rows.append(gesture.episode.features())
            if gesture.state == ENDED:
                ended.append(gesture)
    ended.sort(key=lambda gesture: -gesture.impulse)
    total = sum(gesture.impulse for gesture in ended)
    return [
        Glances(early[gesture.id], gesture.episode.features(), gesture.impulse / total)
        for gesture in ended
    ]


def train(table: Takes, about: dict, trees: int = TREES) -> GestureModel:
    """Train a recogniser on two classes or more, two takes of each.

    Raises:
        ModuleNotFoundError: scikit-learn is missing.
    """
    classes, label = np.unique(table.label, return_inverse=True)
    sharpness = sharpness_of(table, left_out(table, trees))
    forest, logistic = fit(table, label, np.ones(len(label), bool), trees)
    return GestureModel(tuple(map(str, classes)), forest, logistic, sharpness, about)


def sharpness_of(table: Takes, shares: np.ndarray) -> float:
    """Return the exponent by which shares (rows, classes) are as sure as they are right."""
    label = np.unique(table.label, return_inverse=True)[1]
    right = float(np.average(shares.argmax(1) == label, weights=table.weight))

    def too_sure(sharpness: float) -> float:
        sure = sharpened(shares, sharpness).max(1)
        return float(np.average(sure, weights=table.weight)) - right

    low, high = _SHARPNESS
    if too_sure(high) < 0.0:
        return high
    return float(brentq(too_sure, low, high)) if too_sure(low) < 0.0 else low


def left_out(table: Takes, trees: int = TREES) -> np.ndarray:
    """Return (rows, classes) shares of each row by a forest and a line that knew not its person.

    Where a gesture is of one person only, by those that knew not its take.
    """
    classes, label = np.unique(table.label, return_inverse=True)
    groups = _folds(table)
    shares = np.zeros((len(label), len(classes)))
    for group in np.unique(groups):
        out = groups == group
        forest, logistic = fit(table, label, ~out, trees)
        rows = table.features[out]
        trees_say = np.array([forest.shares(row) for row in rows])
        shares[out] = common(trees_say, logistic.shares(rows))
    return shares


def _folds(table: Takes) -> np.ndarray:
    """Return the group of each row: of people, or of takes if one person made a gesture."""
    person = np.unique(table.person, return_inverse=True)[1]
    alone = any(len(np.unique(person[table.label == label])) == 1 for label in set(table.label))
    return (table.take if alone else person) % FOLDS


def fit(
    table: Takes, label: np.ndarray, use: np.ndarray, trees: int = TREES, seed: int = 0
) -> tuple[Forest, Logistic]:
    """Fit a forest and a line to some rows of a table.

    Args:
        label: (rows,) number of each row's class.
        use: (rows,) bool.

    Raises:
        ModuleNotFoundError: scikit-learn is missing.
    """
    from sklearn.ensemble import ExtraTreesClassifier
    from sklearn.linear_model import LogisticRegression

    rng = np.random.default_rng(seed)
    forces = [FEATURES.index(name) for name in _LOGARITHMS_OF_FORCE]
    known, label_of = np.unique(label[use], return_inverse=True)
    weight = table.weight[use] / np.bincount(label_of)[label_of]
    weight = np.where(table.label[use] == OTHER, OTHER_COUNTS * weight, weight)
    rows = []
    for copy in range(COPIES):
        stronger = STRONGER * rng.standard_normal(table.take.max() + 1) * (copy > 0)
        rows.append(table.features[use])
        rows[-1][:, forces] += stronger[table.take[use]][:, None]
    features, labels = np.concatenate(rows), np.tile(label_of, COPIES)
    weights = np.tile(weight, COPIES)
    leaf = max(LEAF, round(LEAF_SHARE * len(np.unique(table.take[use]))))
    fitted = ExtraTreesClassifier(
        trees, max_features=CHOICE, min_samples_leaf=leaf * COPIES, random_state=seed
    ).fit(features.astype(np.float32), labels, weights)
    mean, scale = features.mean(0), features.std(0) + _STEADY
    regression = LogisticRegression(C=FREEDOM, max_iter=1000).fit(
        np.clip((features - mean) / scale, -CLIP, CLIP), labels, weights / weights.mean() / COPIES
    )
    return _of_all(plain(fitted), mean, scale, regression, known, label.max() + 1)


def _of_all(forest: Forest, mean, scale, regression, known: np.ndarray, classes: int):
    """Return forest and regression over all classes, where some were left out of the fit."""
    share = np.zeros((len(forest.share), classes))
    share[:, known] = forest.share
    weights, bias = np.zeros((classes, len(mean))), np.full(classes, _NEVER)
    if len(known) == 2:  # scikit-learn gives the difference of the two
        weights[known[1]], bias[known] = regression.coef_[0], (0.0, regression.intercept_[0])
    else:
        weights[known], bias[known] = regression.coef_, regression.intercept_
    return forest._replace(share=share), Logistic(mean, scale, weights, bias)


def plain(fitted) -> Forest:
    """Return a scikit-learn forest as plain numbers."""
    parts: dict[str, list[np.ndarray]] = {name: [] for name in Forest._fields}
    start = 0
    for tree in fitted.estimators_:
        nodes = tree.tree_
        inner = nodes.children_left >= 0
        share = nodes.value[:, 0, :] / nodes.value[:, 0, :].sum(1, keepdims=True)
        parts["feature"].append(np.where(inner, nodes.feature, -1).astype(np.int16))
        parts["threshold"].append(np.where(inner, nodes.threshold, 0.0).astype(np.float32))
        parts["below"].append(np.where(inner, nodes.children_left + start, 0).astype(np.int32))
        parts["above"].append(np.where(inner, nodes.children_right + start, 0).astype(np.int32))
        parts["share"].append(np.where(inner[:, None], 0.0, share).astype(np.float16))
        parts["roots"].append(np.array([start], np.int32))
        start += nodes.node_count
    forest = Forest(*(np.concatenate(parts[name]) for name in Forest._fields))
    return forest._replace(share=forest.share.astype(float))

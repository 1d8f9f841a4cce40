"""Trains a recogniser of gestures from takes: recordings of one gesture each, by name and person.

Needs scikit-learn (the extra `gestures`); what it makes runs without.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from ..touch.episode import FEATURES, SILENCE, Episode
from ..touch.forest import Forest
from ..touch.model import CLIP, GestureModel, Logistic, common, sharpened
from ..touch.take import Take

# s of a gesture after which it is learnt as well: a decision need not wait for its end
GLANCES = (0.12, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.5)
TREES = 100  # more change no figure by its standard error
LEAF = 2  # takes in a leaf at least
CHOICE = 0.3  # share of the features that a node may choose from (as in the study of docs/gestures)
STRONGER = 0.3  # std of the logarithm of force: people press harder or lighter than those recorded
COPIES = 3  # of each take, with other forces
FOLDS = 4  # groups of people that are left out in turn, to see how sure the trees may be
FREEDOM = 0.3  # inverse of the penalty on the regression's weights
_STEADY = 1e-6  # added to the std of a feature that does not vary
_NEVER = -50.0  # score of a class that a fit has not seen
_SHARPEST = 8.0
_LOGARITHMS_OF_FORCE = (
    *("force_mean", "force_max", "peak_mean", "peak_max", "pressure"),
    *("rise", "fall", "change"),
)


class Table(NamedTuple):
    """Features of many takes, some times into each and at its end."""

    features: np.ndarray  # (rows, len(FEATURES))
    label: np.ndarray  # (rows,) str
    person: np.ndarray  # (rows,) str
    weight: np.ndarray  # (rows,); those of a take sum to 2, half of them its end's
    end: np.ndarray  # (rows,) bool: the gesture is over
    take: np.ndarray  # (rows,) int


def table_of(takes: Sequence[Take]) -> Table:
    """Return the features of takes; those without a touch are left out."""
    features, where, weight, end = [], [], [], []
    for number, take in enumerate(takes):
        early, last = glances(take)
        if last is None:
            continue
        rows = [*early, last]
        features += rows
        where += [number] * len(rows)
        weight += [1.0 / max(len(early), 1)] * len(early) + [1.0]
        end += [False] * len(early) + [True]
    taken = np.array(where, int)
    return Table(
        np.array(features).reshape(-1, len(FEATURES)),
        np.array([takes[k].label for k in where], object).astype(str),
        np.array([takes[k].person for k in where], object).astype(str),
        np.array(weight),
        np.array(end, bool),
        taken,
    )


def glances(take: Take) -> tuple[list[np.ndarray], np.ndarray | None]:
    """Return the features at GLANCES, and at the end of a take; None where nothing touches."""
    touched = np.flatnonzero(take.pictures.any((1, 2)))
    if len(touched) == 0:
        return [], None
    episode = Episode(take.pictures.shape[1:], take.pitch, take.period)
    early, due = [], list(GLANCES)
    for picture in take.pictures[touched[0] : touched[-1] + 1]:
        episode.add(picture)
        if due and episode.duration >= due[0] - take.period / 2:
            early.append(episode.features())
            while due and episode.duration >= due[0] - take.period / 2:
                del due[0]
    nothing = np.zeros(take.pictures.shape[1:])
    while episode.silence < SILENCE:
        episode.add(nothing)
    return early, episode.features()


def train(table: Table, about: dict, trees: int = TREES, seed: int = 0) -> GestureModel:
    """Train a recogniser.

    Args:
        table: two classes or more, two takes of each.
        about: what the model says of its data.

    Raises:
        ModuleNotFoundError: scikit-learn is missing.
    """
    classes, label = np.unique(table.label, return_inverse=True)
    shares = left_out(table, trees, seed)

    def loss(sharpness: float) -> float:
        right = sharpened(shares, sharpness)[np.arange(len(label)), label]
        return -float(table.weight @ np.log(right))

    sharpness = float(minimize_scalar(loss, bounds=(0.5, _SHARPEST), method="bounded").x)
    forest, logistic = _fit(table, label, np.ones(len(label), bool), trees, seed)
    return GestureModel(tuple(map(str, classes)), forest, logistic, sharpness, about)


def left_out(table: Table, trees: int = TREES, seed: int = 0) -> np.ndarray:
    """Return (rows, classes) shares of each row by a forest and a line that knew not its person.

    With one person only, by those that knew not its take.
    """
    classes, label = np.unique(table.label, return_inverse=True)
    groups = _folds(table)
    shares = np.zeros((len(label), len(classes)))
    for group in np.unique(groups):
        out = groups == group
        forest, logistic = _fit(table, label, ~out, trees, seed)
        rows = table.features[out]
        trees_say = np.array([forest.shares(row) for row in rows])
        shares[out] = common(trees_say, logistic.shares(rows))
    return shares


def _folds(table: Table) -> np.ndarray:
    """Return (rows,) the group that each row is left out with: people, or takes of the only one."""
    people, person = np.unique(table.person, return_inverse=True)
    return (person if len(people) > 1 else table.take) % FOLDS


def _fit(
    table: Table, label: np.ndarray, use: np.ndarray, trees: int, seed: int
) -> tuple[Forest, Logistic]:
    from sklearn.ensemble import ExtraTreesClassifier
    from sklearn.linear_model import LogisticRegression

    rng = np.random.default_rng(seed)
    forces = [FEATURES.index(name) for name in _LOGARITHMS_OF_FORCE]
    known, label_of = np.unique(label[use], return_inverse=True)
    weight = table.weight[use] / np.bincount(label_of)[label_of]
    rows = []
    for copy in range(COPIES):
        stronger = STRONGER * rng.standard_normal(table.take.max() + 1) * (copy > 0)
        rows.append(table.features[use])
        rows[-1][:, forces] += stronger[table.take[use]][:, None]
    features, labels = np.concatenate(rows), np.tile(label_of, COPIES)
    weights = np.tile(weight, COPIES)
    fitted = ExtraTreesClassifier(
        trees, max_features=CHOICE, min_samples_leaf=LEAF * COPIES, random_state=seed
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

"""What a recogniser has learnt: its classes, a forest and a line, in a file of plain numbers.

A forest sees what belongs together, a logistic regression what adds up; of people that neither has
seen their common opinion is right more often than either's.
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import FileError
from .episode import FEATURES
from .forest import Forest

OTHER = "other"  # what is no gesture that the model knows
MOST_BYTES = 50_000_000  # of a file: a forest of 32 classes has 5 million
VERSION = 1  # of the file
CLIP = 4.0  # standard deviations: a feature far out says no more
TREES_SAY = 0.7  # weight of the forest: chosen on two people's real gestures, the other's left out
_LEAST = 1e-6  # share of a class that no tree has seen there


class Logistic(NamedTuple):
    """A multinomial logistic regression.

    Attributes:
        mean, scale: (n,) of the features; they are clipped to CLIP scales.
        weights: (classes, n).
        bias: (classes,).
    """

    mean: np.ndarray
    scale: np.ndarray
    weights: np.ndarray
    bias: np.ndarray

    def shares(self, features: np.ndarray) -> np.ndarray:
        """Return the probability of each class (..., classes) of features (..., n)."""
        z = np.clip((features - self.mean) / self.scale, -CLIP, CLIP)
        score = z @ self.weights.T + self.bias
        raised = np.exp(score - score.max(-1, keepdims=True))
        return np.asarray(raised / raised.sum(-1, keepdims=True))

    def check(self, features: int, classes: int) -> None:
        """Raise ValueError where the numbers are no regression of so many features and classes."""
        shapes = tuple(part.shape for part in self)
        if (
            shapes != ((features,), (features,), (classes, features), (classes,))
            or not all(np.isfinite(part).all() for part in self)
            or not (self.scale > 0.0).all()
        ):
            raise ValueError("the logistic regression is damaged")


class GestureModel(NamedTuple):
    """Names gestures by their features.

    Attributes:
        classes: names, in the order of the probabilities.
        forest: over `episode.FEATURES`.
        logistic: over the same features.
        sharpness: exponent that makes their shares probabilities: of people left out it is as sure
            on average as it is right.
        about: what it was trained on: people, takes a class, boards, date.
    """

    classes: tuple[str, ...]
    forest: Forest
    logistic: Logistic
    sharpness: float
    about: dict[str, Any]

    def probabilities(self, features: np.ndarray) -> np.ndarray:
        """Return the probability of each class.

        Args:
            features: (len(FEATURES),) of `Episode.features`.
        """
        both = common(self.forest.shares(features), self.logistic.shares(features))
        return sharpened(both, self.sharpness)

    def save(self, path: str | Path) -> None:
        """Write the model to an .npz file of plain numbers."""
        head = {
            "version": VERSION,
            "classes": self.classes,
            "features": FEATURES,
            "sharpness": self.sharpness,
            "about": self.about,
        }
        text = np.frombuffer(json.dumps(head).encode(), np.uint8)
        small = self.forest._replace(share=self.forest.share.astype(np.float16))
        with open(path, "wb") as file:
            np.savez_compressed(file, head=text, **small._asdict(), **self.logistic._asdict())


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
    path = Path(path)
    try:
        if path.stat().st_size > MOST_BYTES:
            raise FileError(f"{path}: larger than {MOST_BYTES} bytes: is it a gesture model?")
        with np.load(path, allow_pickle=False) as data:
            head = json.loads(bytes(data["head"]).decode())
            if head["version"] != VERSION or tuple(head["features"]) != FEATURES:
                raise FileError(
                    f"{path}: was trained by another version, on other features: train it again "
                    "with 'tactile-skin gestures train'"
                )
            forest = Forest(*(data[name] for name in Forest._fields))
            forest = forest._replace(share=forest.share.astype(float))
            logistic = Logistic(*(np.asarray(data[name], float) for name in Logistic._fields))
            classes, sharpness = tuple(map(str, head["classes"])), float(head["sharpness"])
        forest.check(len(FEATURES))
        logistic.check(len(FEATURES), len(classes))
        if forest.share.shape[1] != len(classes):
            raise ValueError(f"{len(classes)} classes, but {forest.share.shape[1]} in its trees")
    except OSError as error:
        raise FileError(f"{path}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise FileError(f"{path}: is no gesture model: {error}") from error
    return GestureModel(classes, forest, logistic, sharpness, head["about"])

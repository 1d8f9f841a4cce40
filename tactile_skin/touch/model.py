"""What a recogniser has learnt: its classes and a forest, in a file of plain numbers."""

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


class GestureModel(NamedTuple):
    """Names gestures by their features.

    Attributes:
        classes: names, in the order of the probabilities.
        forest: over `episode.FEATURES`.
        sharpness: exponent that makes shares of trees probabilities; chosen on people left out.
        about: what it was trained on: people, takes a class, boards, date.
    """

    classes: tuple[str, ...]
    forest: Forest
    sharpness: float
    about: dict[str, Any]

    def probabilities(self, features: np.ndarray) -> np.ndarray:
        """Return the probability of each class.

        Args:
            features: (len(FEATURES),) of `Episode.features`.
        """
        return sharpened(self.forest.shares(features), self.sharpness)

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
            np.savez_compressed(file, head=text, **small._asdict())


def sharpened(shares: np.ndarray, sharpness: float) -> np.ndarray:
    """Return probabilities of trees' shares (..., classes), which are cautious."""
    raised = np.maximum(shares, 1e-6) ** sharpness
    return raised / raised.sum(-1, keepdims=True)


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
            classes, sharpness = tuple(map(str, head["classes"])), float(head["sharpness"])
        forest.check(len(FEATURES))
        if forest.share.shape[1] != len(classes):
            raise ValueError(f"{len(classes)} classes, but {forest.share.shape[1]} in its trees")
    except OSError as error:
        raise FileError(f"{path}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise FileError(f"{path}: is no gesture model: {error}") from error
    return GestureModel(classes, forest, sharpness, head["about"])

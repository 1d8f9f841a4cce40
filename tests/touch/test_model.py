# SPDX-License-Identifier: Apache-2.0
"""A model is plain numbers: trees that answer as trained, in a file."""

import json

import numpy as np
import pytest

from tactile_skin.errors import FileError
from tactile_skin.touch.episode import FEATURES
from tactile_skin.touch.model import TREES_SAY, Forest, GestureModel, Logistic, load_model

N = len(FEATURES)


def stump(feature: int = 0, threshold: float = 0.5) -> Forest:
    """Asks one feature: below, the first class, above, the second."""
    return Forest(
        np.array([feature, -1, -1]),
        np.array([threshold, 0.0, 0.0]),
        np.array([1, 0, 0]),
        np.array([2, 0, 0]),
        np.array([[0.0, 0.0], [0.9, 0.1], [0.2, 0.8]]),
        np.array([0]),
    )


def line(classes: int = 2) -> Logistic:
    """Has no opinion."""
    return Logistic(np.zeros(N), np.ones(N), np.zeros((classes, N)), np.zeros(classes))


def model(forest: Forest | None = None, logistic: Logistic | None = None) -> GestureModel:
    both = forest or stump(), logistic or line()
    return GestureModel(("pat", "stroke"), *both, 2.0 / TREES_SAY, {"people": 3})


def test_a_forest_answers_as_the_one_that_was_trained():
    ensemble = pytest.importorskip("sklearn.ensemble")
    from tactile_skin.learning.gestures import plain

    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((200, N)).astype(np.float32), rng.integers(0, 5, 200)
    fitted = ensemble.ExtraTreesClassifier(20, random_state=0).fit(x, y)
    forest = plain(fitted)
    asked = rng.standard_normal((50, N)).astype(np.float32)
    expected = fitted.predict_proba(asked)
    assert np.array([forest.shares(row) for row in asked]) == pytest.approx(expected, abs=1e-3)


def test_sharper_is_surer_and_sums_to_one():
    probabilities = model().probabilities(np.zeros(N))
    assert probabilities == pytest.approx(np.array([0.81, 0.01]) / 0.82)


def test_a_model_is_the_same_after_a_file(tmp_path):
    path = tmp_path / "mine.gestures.npz"
    model().save(path)
    read = load_model(path)
    assert read.classes == ("pat", "stroke") and read.about == {"people": 3}
    for value in (0.0, 1.0):
        features = np.full(N, value)
        assert read.probabilities(features) == pytest.approx(
            model().probabilities(features), rel=1e-3
        )


def test_files_that_are_no_model_are_refused(tmp_path):
    absent, text, pickled = (tmp_path / name for name in ("absent", "text", "pickled"))
    text.write_text("gestures")
    np.savez(pickled, head=np.array([{"a": 1}], object), allow_pickle=True)
    for path in (absent, text, tmp_path / "pickled.npz"):
        with pytest.raises(FileError, match=path.stem):
            load_model(path)


def test_a_model_of_other_features_is_refused(tmp_path):
    path = tmp_path / "old.gestures.npz"
    model().save(path)
    with np.load(path) as data:
        parts = dict(data)
    head = json.loads(bytes(parts["head"]).decode())
    head["features"] = head["features"][1:]
    parts["head"] = np.frombuffer(json.dumps(head).encode(), np.uint8)
    np.savez(path, **parts)
    with pytest.raises(FileError, match="train it again"):
        load_model(path)

# SPDX-License-Identifier: Apache-2.0
"""Takes in files, and the touches of a recording as takes."""

import numpy as np
import pytest

from tactile_skin.errors import FileError
from tactile_skin.touch.take import SUFFIX, Take, find_takes, load_take, touches

TAKE = Take("stroke", "anna", np.ones((4, 3, 2)), 0.04, 0.018)


def test_a_take_is_the_same_after_a_file(tmp_path):
    path = tmp_path / f"one{SUFFIX}"
    TAKE.save(path)
    read = load_take(path)
    assert read[:2] == TAKE[:2] and read[3:] == TAKE[3:]
    assert np.array_equal(read.pictures, TAKE.pictures)
    assert list(find_takes([tmp_path])) == [path] == list(find_takes([path]))


@pytest.mark.parametrize(
    "take",
    [
        TAKE._replace(pictures=np.ones((4, 3))),
        TAKE._replace(pictures=-np.ones((4, 3, 2))),
        TAKE._replace(pictures=np.full((4, 3, 2), np.nan)),
        TAKE._replace(period=0.0),
        TAKE._replace(pitch=-1.0),
    ],
)
def test_numbers_that_are_no_take_are_refused(tmp_path, take):
    path = tmp_path / "wrong"
    take.save(path)
    with pytest.raises(FileError, match="wrong: is no take"):
        load_take(path)


def test_what_is_no_take_is_refused_by_name(tmp_path):
    (tmp_path / "text").write_text("stroke")
    for name in ("text", "absent"):
        with pytest.raises(FileError, match=name):
            load_take(tmp_path / name)
    with pytest.raises(FileError, match="absent: does not exist"):
        list(find_takes([tmp_path / "absent"]))
    with pytest.raises(FileError, match="holds no take"):
        list(find_takes([tmp_path]))


def test_touches_are_parted_by_a_pause():
    on = np.array([0, 1, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0])
    pictures = on[:, None, None] * np.ones((14, 2, 2))
    parts = touches(pictures, period=0.2)
    assert [len(part) for part in parts] == [5, 1]
    assert touches(np.zeros((5, 2, 2)), 0.2) == []

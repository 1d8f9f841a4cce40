# SPDX-License-Identifier: Apache-2.0
"""Recordings of others become takes: forces are kept, and gestures are parted."""

import numpy as np
import pytest

from benchmarks.gestures import cost
from benchmarks.gestures.recorded import PITCH, recorded
from tactile_skin.errors import FileError


def test_recorded_hands_keep_their_force_on_other_cells(tmp_path):
    frames = np.full((5, 19, 24), 20, np.uint8)
    frames[1:4, 8:11, 10:14] = 200
    path = tmp_path / "hands.npz"
    np.savez(path, frames=frames, n=[5], label=[8], person=[1])
    (fine,), (coarse,) = recorded(path, coarse=False), recorded(path)
    assert fine.pitch == PITCH and coarse.pictures.shape == (5, 16, 16)
    assert coarse.pictures.sum((1, 2)) == pytest.approx(fine.pictures.sum((1, 2)))
    assert fine.label == "8" and not fine.pictures[0].any() and fine.pictures[2].any()


def corpus(path, rows):
    channels = ",".join(f"ch{k}" for k in range(64))
    text = "\n".join(",".join(map(str, row)) for row in rows)
    path.write_text(f"gesture, subject, variant, frame,{channels}\n{text}\n")
    return path


def frame(gesture, subject, number, count):
    return [gesture, subject, 1, number, *[0] * 27, count, *[0] * 36]


def test_the_corpus_is_parted_where_frames_do_not_follow(tmp_path):
    rows = [frame(6, 3, k, 100 * (k > 1)) for k in range(1, 21)]
    rows += [frame(6, 3, k, 50 * (k > 1)) for k in range(1, 13)]
    rows += [frame(14, 4, k, 90 * (k > 1)) for k in range(1, 8)]
    found = list(cost.takes(corpus(tmp_path / "CoST.csv", rows), 0.02))
    assert [(t.label, t.person, len(t.pictures)) for t in found] == [
        ("poke", "subject3", 4),
        ("poke", "subject3", 2),
        ("tickle", "subject4", 1),
    ]
    assert found[0].pictures[1, 3, 3] == pytest.approx(1.0)


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "gesture,subject,variant,frame,x\n1,1,1,1,5\n"])
def test_another_file_is_refused_by_name(text, tmp_path):
    path = tmp_path / "other.csv"
    path.write_text(text)
    with pytest.raises(FileError, match=r"other\.csv"):
        list(cost.takes(path, 0.02))

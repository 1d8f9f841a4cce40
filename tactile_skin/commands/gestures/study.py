# SPDX-License-Identifier: Apache-2.0
"""What takes teach: a recogniser, and how good it is."""

from __future__ import annotations

import datetime
import functools
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ... import extras
from ...bench.chart import prepare
from ...learning import gestures as learning
from ...learning.gestures import GLANCES, left_out, sharpness_of, table_of
from ...learning.hands import PEOPLE, simulated
from ...parameters.nodes import Gestures
from ...touch.episode import FEATURES
from ...touch.model import OTHER, load_model, sharpened
from ...touch.take import find_takes, load_take

_DPI = 100  # of the picture
_CELL = 0.42  # inches of a class in it
_FEW = 3  # takes of a class, with fewer of which it is not trained


def _read(paths):
    return [
        load_take(path)
        for path in extras.tqdm()(list(find_takes(paths)), desc="takes", disable=None)
    ]


def train(args) -> int:
    if args.alone and not args.takes:
        raise ValueError("--alone needs takes: name their files or folders")
    takes = _read(args.takes)
    count = Counter(take.label for take in takes)
    few = [f"{name}: {n}" for name, n in sorted(count.items()) if n < _FEW]
    if few:
        raise ValueError(f"{_FEW} takes of a gesture at least are needed; of {', '.join(few)}")
    people = sorted({take.person for take in takes})
    if not args.alone:
        takes += extras.tqdm()(simulated(), desc="simulated hands", leave=False, disable=None)
        people.append(f"{PEOPLE} simulated")
    track = functools.partial(extras.tqdm(), desc="features", leave=False, disable=None)
    table = table_of(takes, track=track, jobs=args.jobs)
    if len(set(table.label)) < 2:
        raise ValueError("one gesture alone cannot be recognised: record another one, or 'other'")
    about = {
        "trained": datetime.date.today().isoformat(),
        "people": people,
        "takes": dict(count),
        "pitch": sorted({round(take.pitch, 4) for take in takes}),
    }
    model = learning.train(table, about)
    model.save(args.out)
    print(f"{args.out}: {', '.join(model.classes)}; from {len(takes)} takes")
    return 0


def evaluate(args) -> int:
    if args.picture:
        prepare()
    takes = _read(args.takes)
    if not args.model and len({take.label for take in takes}) < 2:
        raise ValueError("takes of two gestures at least are needed")
    track = functools.partial(extras.tqdm(), desc="features", leave=False, disable=None)
    table = table_of(takes, track=track)
    if args.model:
        model = load_model(args.model)
        classes = np.array(model.classes)
        shares = np.array([model.probabilities(row) for row in table.features])
        print(f"{args.model}: {model.about}")
    else:
        classes = np.unique(table.label)
        shares = left_out(table)
        shares = sharpened(shares, sharpness_of(table, shares))
        people = len(set(table.person))
        print("people left out in turn" if people > 1 else "one person: takes left out in turn")
    named = classes[shares.argmax(1)]
    label, ends = table.label[table.end], named[table.end]
    print(_confusion(label, ends))
    for person in sorted(set(table.person)):
        his = table.person[table.end] == person
        print(f"{person}: {_share(label[his] == ends[his])}")
    print(f"right: {_share(label == ends)}")
    soon = _soon(table, named == table.label, shares.max(1))
    print(_as_text(soon))
    false = _false(table, named, shares.max(1))
    print(false)
    if args.picture:
        draw(args.picture, label, ends, soon, false)
        print(args.picture)
    return 0


def _share(right) -> str:
    mean = float(right.mean())
    error = (mean * (1.0 - mean) / len(right)) ** 0.5
    return f"{mean:.3f} +- {error:.3f} of {len(right)} takes"


class Soon(NamedTuple):
    """How soon gestures are named."""

    after: float  # [s]
    of_all: float  # share of the gestures that go on which are named
    right: float  # share of these that are named rightly


def _soon(table, right, sure) -> list[Soon]:
    after = np.exp(table.features[:, FEATURES.index("duration")])
    rows = []
    for k, seconds in enumerate(GLANCES[:-1]):
        now = ~table.end & (after >= seconds - 0.02) & (after < GLANCES[k + 1] - 0.02)
        named = now & (sure >= Gestures.min_probability)
        if named.any():
            rows.append(Soon(seconds, named.sum() / now.sum(), float(right[named].mean())))
    return rows


def _false(table, named, sure) -> str:
    """Return how many gestures are named, at their end, in an hour of contacts that are none."""
    none = table.end & (table.label == OTHER)
    if not none.any():
        return f"false gestures an hour: unknown, nothing was recorded as {OTHER!r}"
    hours = np.exp(table.features[none, FEATURES.index("duration")]).sum() / 3600.0
    false = int((none & (named != OTHER) & (sure >= Gestures.min_probability)).sum())
    return f"false gestures: {false} of {none.sum()}, {false / hours:.0f} an hour of {OTHER!r}"


def _as_text(rows: list[Soon]) -> str:
    lines = [f"sure to {Gestures.min_probability:g} after   of all   of these right"]
    lines += [f"{row.after:17.2f} s   {row.of_all:6.3f}   {row.right:8.3f}" for row in rows]
    return "\n".join(lines)


def _confusion(label, named) -> str:
    """Return a table: a row a gesture, a column what it was taken for."""
    names = sorted({*label, *named})
    wide = max(map(len, names))
    heads = " ".join(f"{name[:7]:>7}" for name in names)
    lines = [f"{'':{wide}}  {heads}"]
    for name in sorted(set(label)):
        counts = [int(np.count_nonzero((label == name) & (named == other))) for other in names]
        lines.append(f"{name:{wide}}  " + " ".join(f"{n or '.':>7}" for n in counts))
    return "\n".join(lines)


def draw(path: Path, label: np.ndarray, named: np.ndarray, soon: list, false: str) -> None:
    """Write the picture of an evaluation.

    Args:
        label: (takes,) name of each gesture.
        named: (takes,) what it was taken for at its end.
        soon: rows of `Soon`.
        false: how many false gestures there are.

    Raises:
        ValueError: the file is of a type that matplotlib does not write.
    """
    from matplotlib import pyplot as plt

    names = sorted({*label, *named})
    side = max(3.2, _CELL * len(names))
    figure, (matrix, times) = plt.subplots(
        1, 2, figsize=(side + 4.6, side + 0.8), layout="constrained", width_ratios=(side, 3.2)
    )
    row, col = (np.searchsorted(names, values) for values in (label, named))
    count = np.zeros((len(names), len(names)), int)
    np.add.at(count, (row, col), 1)
    share = count / np.maximum(count.sum(1, keepdims=True), 1)
    matrix.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0)
    for r, c in zip(*count.nonzero(), strict=True):
        colour = "white" if share[r, c] > 0.5 else "black"
        matrix.text(c, r, count[r, c], ha="center", va="center", color=colour, fontsize=8)
    matrix.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=9)
    matrix.set_yticks(range(len(names)), names, fontsize=9)
    matrix.set_xlabel("taken for")
    matrix.set_ylabel("gesture")
    matrix.set_title(f"{np.mean(label == named):.1%} of {len(label)} takes are right", fontsize=9.5)
    figure.suptitle(false, fontsize=9.5)
    after = [entry.after for entry in soon]
    for name, colour, line in (("of_all", "#0072b2", "-"), ("right", "#d55e00", "--")):
        text = {"of_all": "of all named", "right": "of these right"}[name]
        values = [getattr(entry, name) for entry in soon]
        times.plot(after, values, line, marker="o", color=colour, label=text)
    times.set_xlabel("after the first touch [s]")
    times.set_ylabel("share")
    times.set_ylim(0.0, 1.02)
    times.set_title(f"sure to {Gestures.min_probability:g}", fontsize=9.5)
    times.grid(alpha=0.25, linewidth=0.6)
    times.legend(fontsize=8.5, frameon=False, loc="lower right")
    try:
        figure.savefig(path, dpi=_DPI)
    finally:
        plt.close(figure)

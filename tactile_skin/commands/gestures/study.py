# SPDX-License-Identifier: Apache-2.0
"""What takes teach: a recogniser, and how good it is."""

from __future__ import annotations

import datetime
import functools
from collections import Counter
from pathlib import Path

import numpy as np

from ... import extras
from ...bench.chart import prepare
from ...learning import gestures as learning
from ...learning.gestures import left_out, sharpness_of, table_of
from ...learning.hands import PEOPLE, simulated
from ...parameters.nodes import Gestures
from ...touch.episode import FEATURES
from ...touch.model import OTHER, load_model, sharpened
from ...touch.take import SUFFIX, Take, find_takes, load_take
from .record import of_table

_DPI = 100  # of the picture
# inches: of a class in it, and of all of it at least
_CELL = 0.55
_SMALLEST = 6.5
_FEW = 3  # takes of a class, with fewer of which it is not trained


def _read(args) -> list[Take]:
    takes: list[Take] = []
    for path in extras.track(list(find_takes(args.takes)), desc="takes"):
        if path.name.endswith(SUFFIX) or not args.config:
            takes.append(load_take(path))
        else:
            takes += of_table(str(path), {"config": str(args.config)}, "", "me")
    return takes


def train(args) -> int:
    if args.alone and (args.simulated or not args.takes):
        raise ValueError("--alone needs takes and no --simulated: name their files or folders")
    takes = _read(args)
    count = Counter(take.label for take in takes)
    few = [f"{name}: {n}" for name, n in sorted(count.items()) if n < _FEW]
    if few:
        raise ValueError(f"{_FEW} takes of a gesture at least are needed; of {', '.join(few)}")
    people = sorted({take.person for take in takes})
    if args.simulated or not takes:
        takes += extras.track(simulated(), desc="simulated hands")
        people.append(f"{PEOPLE} simulated")
    table = table_of(takes, track=functools.partial(extras.track, desc="features"), jobs=args.jobs)
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
    takes = _read(args)
    if not args.model and len({take.label for take in takes}) < 2:
        raise ValueError("takes of two gestures at least are needed")
    table = table_of(takes, track=functools.partial(extras.track, desc="features"))
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
    false = _false(table, named, shares.max(1))
    print(false)
    if args.picture:
        draw(args.picture, label, ends, f"{np.mean(label == ends):.1%} are right; {false}")
        print(args.picture)
    return 0


def _share(right) -> str:
    mean = float(right.mean())
    error = (mean * (1.0 - mean) / len(right)) ** 0.5
    return f"{mean:.3f} +- {error:.3f} of {len(right)} takes"


def _false(table, named, sure) -> str:
    """Return how many gestures are named, at their end, in an hour of contacts that are none."""
    none = table.end & (table.label == OTHER)
    if not none.any():
        return f"false gestures an hour: unknown, nothing was recorded as {OTHER!r}"
    hours = np.exp(table.features[none, FEATURES.index("duration")]).sum() / 3600.0
    false = int((none & (named != OTHER) & (sure >= Gestures.min_probability)).sum())
    return f"false gestures: {false} of {none.sum()}, {false / hours:.0f} an hour of {OTHER!r}"


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


def draw(path: Path, label: np.ndarray, named: np.ndarray, title: str) -> None:
    """Write the picture of an evaluation: what each gesture was taken for.

    Args:
        label: (takes,) name of each gesture.
        named: (takes,) what it was taken for at its end.

    Raises:
        ValueError: the file is of a type that matplotlib does not write.
    """
    from matplotlib import pyplot as plt

    metrics = extras.load("sklearn.metrics", "the picture needs scikit-learn", "gestures")
    side = max(_SMALLEST, _CELL * len({*label, *named}))
    figure, axes = plt.subplots(figsize=(side, side), layout="constrained")
    metrics.ConfusionMatrixDisplay.from_predictions(
        label, named, cmap="Blues", colorbar=False, xticks_rotation=60, ax=axes
    )
    axes.set(xlabel="taken for", ylabel="gesture", title=title)
    try:
        figure.savefig(path, dpi=_DPI)
    finally:
        plt.close(figure)

# SPDX-License-Identifier: Apache-2.0
"""Draws training curves."""

from __future__ import annotations

import csv
from pathlib import Path

from .. import harness

_STYLES = ("-", "--", ":", "-.")


def read(path: Path) -> tuple[list[int], list[float]]:
    """Epochs and validation error [g a cell] of a `history.csv` of `tactile-skin train`."""
    with path.open() as file:
        lines = list(csv.DictReader(file))
    return [int(x["epoch"]) for x in lines], [float(x["validation_g"]) for x in lines]


def draw(histories: dict[str, Path], out: Path) -> None:
    """One curve a run, named by its key."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(7.0, 4.0), layout="constrained")
    for k, (name, path) in enumerate(histories.items()):
        epochs, error = read(path)
        axis.plot(epochs, error, _STYLES[k % len(_STYLES)], label=f"{name}: {min(error):.1f} g")
    axis.set_yscale("log")
    low, high = axis.get_ylim()
    axis.set_yticks([t for t in (15, 18, 19, 20, 22, 25, 30, 50, 100) if low <= t <= high])
    axis.yaxis.set_major_formatter("{x:g}")
    axis.minorticks_off()
    axis.set_xlabel("epoch")
    axis.set_ylabel("validation error [g a cell]")
    axis.grid(alpha=0.3)
    axis.legend(frameon=False)
    figure.savefig(out, dpi=110)
    plt.close(figure)


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("out", type=Path, metavar="OUT.png", help="picture to draw")
    parser.add_argument("runs", nargs="+", metavar="NAME=history.csv", help="a run of `train`")
    args = parser.parse_args(arguments)
    runs = [run.partition("=") for run in args.runs]
    for name, equals, path in runs:
        if not equals or not Path(path).is_file():
            parser.error(f"{name}{equals}{path}: must be NAME=FILE, the history.csv of a run")
    draw({name: Path(path) for name, _, path in runs}, args.out)


if __name__ == "__main__":
    harness.run(main)

"""Training curves: `python -m tactile_skin.bench.curves OUT.png NAME=history.csv ...`."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

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
    axis.set_yticks([20, 30, 50, 100], ["20", "30", "50", "100"])
    axis.minorticks_off()
    axis.set_xlabel("epoch")
    axis.set_ylabel("validation error [g a cell]")
    axis.grid(alpha=0.3)
    axis.legend(frameon=False)
    figure.savefig(out, dpi=110)
    plt.close(figure)


def main(words: list[str]) -> None:
    out, *runs = words
    draw({name: Path(path) for name, path in (run.split("=", 1) for run in runs)}, Path(out))


if __name__ == "__main__":
    main(sys.argv[1:])

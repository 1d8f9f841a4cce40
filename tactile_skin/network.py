"""The learned inverse: the paper's convolutional network (Fig. 7), and its weights on disk."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import torch
from torch import nn

from .circuit import Circuit
from .curve import PressureCurve

SHIPPED = Path(__file__).parent / "weights"


class PaperNet(nn.Module):
    """ADC picture -> force picture, the paper's architecture with its 4,544 parameters.

    One row kernel (1 x cols) and one column kernel (rows x 1) sum up each line and join the input
    as channels; three dilated 3x3 convolutions look around; four plain ones compute the force.
    All neurons are ReLUs.

    Args:
        rows, cols: size of the skin in cells.
        adc_mean, adc_std: input standardisation (fixed, not trained): without it a third of the
            runs dies at once.
    """

    def __init__(self, rows: int, cols: int, adc_mean: float = 0.0, adc_std: float = 1.0):
        super().__init__()
        self.register_buffer("adc_mean", torch.tensor(float(adc_mean)))
        self.register_buffer("adc_std", torch.tensor(float(adc_std)))
        self.row = nn.Conv2d(1, 1, (1, cols))
        self.col = nn.Conv2d(1, 1, (rows, 1))
        self.context = nn.ModuleList(nn.Conv2d(3, 9, 3, padding=d, dilation=d) for d in (1, 2, 3))
        self.head = nn.ModuleList(
            nn.Conv2d(c_in, c_out, 3, padding=1)
            for c_in, c_out in ((27, 9), (9, 9), (9, 9), (9, 1))
        )

    def initialise(self):
        """He initialisation; the last bias starts above 0, so that the output ReLU is open."""
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
                nn.init.zeros_(module.bias)
        nn.init.constant_(self.head[-1].bias, 0.1)

    def forward(self, adc):
        """(n, rows, cols) ADC ratio -> (n, rows, cols) force, as a share of the curve's maximum."""
        x = ((adc - self.adc_mean) / self.adc_std).unsqueeze(1)
        lines = [torch.relu(layer(x)).expand_as(x) for layer in (self.row, self.col)]
        x = torch.cat([x, *lines], 1)  # (n, 3, rows, cols)
        x = torch.relu(torch.cat([layer(x) for layer in self.context], 1))  # (n, 27, rows, cols)
        for layer in self.head:
            x = torch.relu(layer(x))
        return x.squeeze(1)


def plain_state(net: nn.Module) -> dict:
    """A copy of the net's state, free of memory layouts."""
    return {k: v.detach().clone().contiguous() for k, v in net.state_dict().items()}


def save(path, state: dict, meta: dict) -> None:
    """Write weights with what they were made for: plain tensors, numbers and strings only."""
    torch.save({"format": 1, "state": state, "meta": meta}, path)


@dataclass(frozen=True, eq=False)
class Weights:
    """A trained network and what it was made for."""

    net: nn.Module
    meta: dict
    path: Path

    def check(self, circuit: Circuit, curve: PressureCurve) -> None:
        """Raise ValueError, naming each difference, unless the weights fit circuit and curve.

        The width of the ADC may differ: the network sees ratios.
        """
        made, here = self.meta["circuit"], circuit.describe()
        differs = [
            f"{key} = {made[key]} (yours: {here[key]})"
            for key in ("rows", "cols", "r_ref", "r_par", "mask")
            if made[key] != here[key]
        ]
        if self.meta["curve"] != curve.describe():
            differs.append("another pressure curve")
        if differs:
            raise ValueError(
                f"weights {self.path} were made for another skin: {', '.join(differs)}; "
                "make your own with `tactile-skin train`, or choose another method"
            )

    @torch.inference_mode()
    def predict(self, adc: np.ndarray) -> np.ndarray:
        """(..., rows, cols) ADC ratio -> force [N], same shape."""
        frames = np.asarray(adc, np.float32).reshape(-1, *adc.shape[-2:])
        share = self.net(torch.from_numpy(frames)).numpy()
        return share.reshape(adc.shape).astype(float) * self.meta["curve"]["force"][-1]


def load(path) -> Weights:
    """Read weights written by `save`.

    Raises:
        ValueError: the file is not one of those; the message names it.
        OSError: it cannot be read.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"weights {path}: no such file")
    try:
        data = torch.load(path, weights_only=True, map_location="cpu")
        if data["format"] != 1:
            raise ValueError(f"format {data['format']}, this version reads 1")
        circuit = data["meta"]["circuit"]
        net = PaperNet(circuit["rows"], circuit["cols"])
        net.load_state_dict(data["state"])
    except Exception as error:  # whatever a foreign file raises in the unpickler
        raise ValueError(f"weights {path}: not a weights file of tactile_skin: {error}") from error
    return Weights(net.eval(), data["meta"], path)


@cache
def shipped(name: str) -> Weights:
    """The weights that come with the package, for the default circuit and curve."""
    return load(SHIPPED / f"{name}.pt")

"""A trained network as ONNX, for a runtime without Python."""

from __future__ import annotations

import importlib.util
import logging
from pathlib import Path

import numpy as np
import torch
from torch import nn

from ..physics.curve import PressureCurve
from . import network
from .training import make_net


class _InNewton(nn.Module):
    """A network that answers in newton on each cell, not in shares of the curve's maximum."""

    def __init__(self, net: nn.Module, scale: float):
        super().__init__()
        self.net, self.scale = net, scale

    def forward(self, inputs):
        return self.net(inputs) * self.scale


def to_onnx(weights: network.Weights, path: Path) -> None:
    """Write a network to `path`: input "inputs" (n, channels, rows, cols), output "force" [N].

    The paper's network takes the ADC ratio (1 channel), the physics network what
    `network.physics_inputs` gives (5 channels first: swap them with n).

    Raises:
        ModuleNotFoundError: the extra `onnx` is not installed.
    """
    if importlib.util.find_spec("onnx") is None or importlib.util.find_spec("onnxscript") is None:
        raise ModuleNotFoundError("the export needs onnx: pip install 'tactile_skin[onnx]'")
    net = make_net(weights.kind, weights.rows, weights.cols)
    net.load_state_dict({k: torch.from_numpy(np.array(v)) for k, v in weights.state.items()})
    channels = 1 if weights.kind == "paper" else network.PHYSICS_INPUTS
    example = torch.zeros(2, channels, weights.rows, weights.cols)
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it misses torchvision, loudly
    torch.onnx.export(
        _InNewton(net, PressureCurve(**weights.meta["curve"]).max_force).eval(),
        (example,),
        str(path),
        input_names=["inputs"],
        output_names=["force"],
        dynamic_shapes={"inputs": {0: torch.export.Dim("n")}},
        external_data=False,
        verbose=False,
    )

# SPDX-License-Identifier: Apache-2.0
"""The optimiser of the trainings: Adam along the axes in which each layer's gradients vary.

SOAP (Vyas et al., "SOAP: Improving and Stabilizing Shampoo using Adam", 2024); Adam takes several
times the steps here (docs/lab/training.md).
"""

from __future__ import annotations

import torch

_DECAY = 0.95, 0.95  # of the means of the gradient, and of its squares and products: the paper's
_LEAST = 1e-8  # of a step's denominator
_TURN = 10  # steps from one turn of the axes to the next: the paper's


class Soap(torch.optim.Optimizer):
    """Adam in the axes in which the gradients of each layer (outputs, ...) vary."""

    def __init__(self, params, lr: float):
        super().__init__(params, {"lr": lr})

    @torch.no_grad()
    def step(self, closure=None):
        for group in self.param_groups:
            for weights in group["params"]:
                gradient = weights.grad.reshape(len(weights), -1)  # (outputs, inputs)
                step = _step(self.state[weights], gradient)
                weights.sub_(step.reshape(weights.shape), alpha=group["lr"])


def _step(state: dict, gradient: torch.Tensor) -> torch.Tensor:
    """Return the step (outputs, inputs) of a layer's gradient; move the layer's state on."""
    products = {"outputs": gradient @ gradient.T, "inputs": gradient.T @ gradient}
    if not state:
        state |= {"count": 0, "mean": torch.zeros_like(gradient)}
        state["square"] = torch.zeros_like(gradient)
        for side, product in products.items():
            state[side] = product
            state[f"axes of {side}"] = torch.linalg.eigh(product)[1]
    mean_decay, square_decay = _DECAY
    state["count"] += 1
    state["mean"].lerp_(gradient, 1.0 - mean_decay)
    left, right = state["axes of outputs"], state["axes of inputs"]
    state["square"].lerp_((left.T @ gradient @ right).square(), 1.0 - square_decay)
    mean = left.T @ state["mean"] @ right / (1.0 - mean_decay ** state["count"])
    square = state["square"] / (1.0 - square_decay ** state["count"])
    step = left @ (mean / (square.sqrt() + _LEAST)) @ right.T
    for side, product in products.items():
        state[side].lerp_(product, 1.0 - square_decay)
        if state["count"] % _TURN == 0:  # a step of the power iteration
            axes = state[f"axes of {side}"]
            state[f"axes of {side}"] = torch.linalg.qr(state[side] @ axes)[0]
    return step

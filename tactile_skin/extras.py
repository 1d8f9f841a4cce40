# SPDX-License-Identifier: Apache-2.0
"""What not every installation has."""

from __future__ import annotations


def torch():
    """PyTorch; ModuleNotFoundError names the extra of ours that has it."""
    try:
        import torch
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("needs PyTorch: pip install 'tactile_skin[train]'") from error
    return torch


def tqdm():
    """Return the progress bar; ModuleNotFoundError names the extra that has it."""
    try:
        from tqdm import tqdm
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "long work shows its progress by tqdm: pip install 'tactile_skin[progress]'"
        ) from error
    return tqdm

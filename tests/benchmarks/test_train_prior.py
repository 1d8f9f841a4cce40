# SPDX-License-Identifier: Apache-2.0
"""The network behind the last step of `map`, as it is trained."""

import numpy as np
import pytest

from tactile_skin.learning import denoiser


def a_fit(shape, rng):
    """x, std, own, unknown, cells as a fit might leave them."""
    cells = rng.random(shape) < 0.9
    unknown = cells & (rng.random(shape) < 0.5)
    x = np.where(unknown, rng.uniform(0.0, 6.0, shape), 0.0)
    return x, rng.uniform(0.001, 5.0, shape), rng.uniform(0.0, 50.0, shape), unknown, cells


@pytest.mark.parametrize("shape", [(16, 16), (4, 9), (1, 3)])
def test_the_pass_is_pytorchs(shape):
    torch = pytest.importorskip("torch")
    from benchmarks.training.train_prior import Net

    torch.manual_seed(1)
    net = Net(channels=6, inner=2)
    ours = denoiser.Denoiser({name: value.numpy() for name, value in net.state_dict().items()})
    x, std, own, unknown, cells = a_fit(shape, np.random.default_rng(0))
    mean, wide = ours(x, std, own, unknown, cells)
    with torch.no_grad():
        inputs = torch.from_numpy(denoiser.inputs(x, std, own, unknown, cells))
        shift, log_share = net(inputs[None])[0].numpy()
    std = np.clip(std, *denoiser.STD)
    np.testing.assert_allclose(mean, x + shift * std, atol=1e-5)
    np.testing.assert_allclose(wide, std * np.exp(np.clip(log_share, *denoiser.SHARE)), rtol=1e-4)


def test_what_it_learns_from_is_what_the_fit_leaves():
    """The training's copy of the last step, without a network, stays where the fit is."""
    torch = pytest.importorskip("torch")
    from benchmarks.training import train_prior

    rng = np.random.default_rng(2)
    fits = [train_prior.fit(train_prior.scene("blobs", rng), rng) for _ in range(3)]
    batch = train_prior.batch_of([f for f in fits if f is not None])
    net = train_prior.Net(channels=4, inner=1)
    for value in net.parameters():
        value.data.zero_()
    with torch.no_grad():
        x, spread = train_prior.last_step(net, batch, turn=5)
    assert np.abs(np.asarray(x - batch[1])).max() < 0.5  # x of an unknown: 0 at rest, 6 at the end
    assert (np.asarray(spread)[np.asarray(batch[-1])] > 0.0).all()

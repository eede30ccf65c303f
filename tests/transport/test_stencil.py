"""The weights of nodes around a point: laws that they hold wherever the point lies."""

import torch

from texsss.transport.stencil import AROUND, VARIANCE, kind_of, kinds, weights


def test_weights_are_positive_and_have_one_mean_and_variance_everywhere():
    generator = torch.Generator().manual_seed(0)
    beyond = torch.rand(20_000, 3, generator=generator, dtype=torch.float64) - 0.5
    beyond[:2000] = torch.randint(0, 5, (2000, 3), generator=generator).double() / 4 - 0.5  # ties and borders
    kind = kind_of(beyond)
    weight = weights(beyond, kind)
    away = torch.tensor(AROUND).double()[kinds()[kind.long()].long()] - beyond[:, None]

    assert len(kind.unique()) == len(kinds()) == 48
    assert float(weight.min()) >= 0
    torch.testing.assert_close(weight.sum(1), torch.ones(len(beyond)).double())
    mean = (weight[..., None] * away).sum(1)
    torch.testing.assert_close(mean, torch.zeros_like(mean), rtol=0, atol=1e-14)
    covariance = torch.einsum("pn,pna,pnb->pab", weight, away, away)
    expected = VARIANCE * torch.eye(3).double().expand_as(covariance)
    torch.testing.assert_close(covariance, expected, rtol=0, atol=1e-14)

"""Light by its angle against the exact solution of a half-space, and the laws that keep energy."""

import numpy as np
import pytest
import torch

from texsss.media import fresnel
from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles.angular import Angular, angular


def chandrasekhar(albedo: float, nodes: int = 64) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss nodes μ of 0..1, their weights, and H(μ). Source: Chandrasekhar 1960, equation V.7."""
    mu, weight = np.polynomial.legendre.leggauss(nodes)
    mu, weight, h = (mu + 1) / 2, weight / 2, np.ones(nodes)
    for _ in range(500):
        inner = (weight * mu * h / (mu[:, None] + mu)).sum(1)
        h = 1 / (np.sqrt(1 - albedo) + albedo / 2 * inner)
    return mu, weight, h


@pytest.mark.parametrize(
    ("channel", "far", "near"), [(0, 0.035, 0.004), (1, 0.042, 0.005), (2, 0.047, 0.006)]
)
def test_a_half_space_sends_out_what_chandrasekhar_says(channel, far, near):
    """More than one scattering: (H H' - 1) / (μ + μ'). One angle at a time to 1.5 %, both at once as said."""
    known = preset("skin1")
    a, s = float(known.sigma_a[channel]), float(known.sigma_s[channel])
    mu, weight, h = chandrasekhar(s / (a + s))
    sent = s / (a + s) / 4 * (np.outer(h, h) - 1) / (mu[:, None] + mu)
    back = 2 * (sent * weight * mu).sum(1)
    total = 2 * (back * weight * mu).sum()
    how = angular(Stack([Layer(Medium(a, s, 0.0, 1.0))]))
    made, beside = (at(torch.from_numpy(mu))[:, 0].numpy() for at in (how.at, how.beside_at))
    np.testing.assert_allclose(made, back / total, rtol=0.015)  # measured .011
    share = np.outer(weight * mu, weight * mu)

    def wrong(guess: np.ndarray) -> float:
        return float(np.sqrt((share * (guess - sent) ** 2).sum() / share.sum()) / total)

    # measured .033, .040, .045; even light .045, .081, .116
    product = total * np.outer(made, made)
    assert wrong(product) < far < wrong(np.full_like(sent, total))
    assert wrong(product + np.outer(beside, beside)) < near  # measured .0033, .0042, .0050
    assert (
        abs((beside * weight * mu).sum()) < 0.007 * (abs(beside) * weight * mu).sum()
    )  # no flux, but for straight lines: .005


@pytest.mark.parametrize("eta", [1.0, 1.3, 1.5])
def test_as_much_leaves_as_if_it_left_evenly(eta):
    """Its mean over what passes the surface is 1."""
    media = [Medium([0.1, 0.02], [1.0, 3.0], 0.5, eta), Medium([0.5, 0.0], [2.0, 1.0], 0.0, eta)]
    made = angular(Stack([Layer(media[0], 0.3), Layer(media[1])]))
    cosine = (torch.arange(2000).double() + 0.5) / 2000
    passes = (cosine * fresnel.transmittance(cosine, eta))[:, None]
    mean = (made.at(cosine) * passes).sum(0) / passes.sum(0)
    torch.testing.assert_close(mean, torch.ones_like(mean), rtol=2e-3, atol=0)
    assert bool((made.table > 0).all())
    assert (made.beside is None) == (eta != 1)


def test_what_lies_between_angles_is_a_straight_line_in_the_root():
    table = Angular(torch.tensor([[0.0], [1.0], [4.0]]), torch.ones(1))
    at = table.at(torch.tensor([-1.0, 0.0, 1 / 16, 9 / 16, 1.0, 2.0]))[:, 0]
    torch.testing.assert_close(at, torch.tensor([0.0, 0.0, 0.5, 2.5, 4.0, 4.0]))

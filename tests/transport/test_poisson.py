"""The Poisson-disc blur: its disc, its width, what it keeps, and answers to bad input."""

import pytest
import torch
from squares import ball, gaussian, lit, square

from texsss.errors import Cancelled, DomainError
from texsss.transport.poisson import diffuse_poisson, poisson_disc


@pytest.mark.parametrize("count", [2, 12, 40])
def test_the_disc_is_centred_even_and_of_variance_one(count: int):
    disc = poisson_disc(count)
    torch.testing.assert_close(disc.mean(0), torch.zeros(2), atol=1e-6, rtol=0)
    torch.testing.assert_close(disc.square().sum() / (2 * count), torch.tensor(1.0))
    apart = torch.pdist(disc)
    # darts thrown at random come five times as close
    assert float(apart.min()) > 0.5 * (2 / count**0.5)


def test_a_spot_spreads_by_the_variance_asked_for():
    texels = square(128, 128.0)
    light = torch.zeros(len(texels), 1)
    position = texels.points.position(texels.mesh)
    centre = (position - 64).square().sum(1) - 64**2  # z is 0
    spot = centre < 16
    light[spot] = 1 / spot.sum()
    variances = torch.tensor([60.0, 150.0])
    for variance, copy in zip(variances.tolist(), diffuse_poisson(light, texels, variances, passes=3)):
        mean = (position * copy).sum(0)
        found = float(((position - mean).square() * copy).sum() / 2)
        own = float(((position - 64)[:, :2].square() * light).sum() / 2)
        # bilinear look-ups add some
        assert found - own == pytest.approx(variance, rel=0.05)


def test_more_passes_come_closer_to_the_gaussian():
    texels = square(96, 96.0)
    position = texels.points.position(texels.mesh)
    squared = (position - position.new_tensor([48.5, 48.5, 0])).square().sum(1)
    light = gaussian(4.0, squared)[:, None]
    expected = gaussian(54.0, squared)[:, None]
    errors = []
    for passes in (1, 2, 4):
        found = diffuse_poisson(light, texels, torch.tensor([50.0]), passes=passes, reduction=1)[0]
        errors.append(float((found - expected).norm() / expected.norm()))
    assert errors[0] > 2 * errors[1] > 2 * errors[2] / 1.01 and errors[2] < 0.12


@pytest.mark.parametrize("reduction", [1, 2, 3])
def test_constants_stay(reduction: int):
    texels = ball(64)
    constant = torch.full((len(texels), 3), 0.7)
    found = diffuse_poisson(constant, texels, torch.tensor([0.0, 40.0, 4000.0]), reduction=reduction)
    torch.testing.assert_close(found, torch.full_like(found, 0.7), rtol=1e-4, atol=0)


def test_no_width_is_the_light_itself():
    texels = ball(32)
    values = lit(texels)
    assert torch.equal(diffuse_poisson(values, texels, torch.zeros(1))[0], values)


def test_bad_input_is_answered_and_it_can_be_stopped():
    texels = ball(32)
    values, wide = lit(texels), torch.tensor([9.0])
    for options in ({"taps": 0}, {"passes": 0}, {"reduction": 0}):
        with pytest.raises(DomainError, match="poisson"):
            diffuse_poisson(values, texels, wide, **options)
    for bad in (-1.0, float("nan"), float("inf")):
        with pytest.raises(DomainError, match="variances"):
            diffuse_poisson(values, texels, torch.tensor([bad]))
    with pytest.raises(Cancelled):
        diffuse_poisson(values, texels, wide, cancel=lambda: True)


@pytest.mark.parametrize("reduction", [1, 3, 5, 7])
def test_the_reduced_image_lies_where_the_whole_one_does(reduction: int):
    """Light that rises along u and v comes back as it was, away from the borders: nothing is shifted."""
    texels = square(64, 64.0)
    place = texels.points.position(texels.mesh)[:, :2]
    rising = place - place.amin(0)
    found = diffuse_poisson(rising, texels, torch.tensor([1e-4]), passes=1, reduction=reduction)[0]
    inside = ((rising > 12) & (rising < 52)).all(1)
    torch.testing.assert_close(found[inside], rising[inside], rtol=0, atol=0.05)

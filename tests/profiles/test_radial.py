"""Profiles over distance, and how far light goes, against closed forms and sums of Gaussians."""

import numpy as np
import pytest
import torch
from reference import multipole
from reference.layers import Layer as Row

from texsss.errors import DomainError
from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles.dipole import dipole, egan_A
from texsss.profiles.fit import fit_gaussians
from texsss.profiles.hankel import hankel_profiles
from texsss.profiles.radial import RadialProfile


def test_the_dipole_and_its_radii():
    """Beyond r the two poles leave z e^-σd / d each."""
    skin = preset("skin1")
    profile = RadialProfile(skin, model="dipole")
    r = torch.tensor([1e-3, 0.01, 0.3, 2.0, 4.0], dtype=torch.float64)
    torch.testing.assert_close(profile.evaluate(r), dipole(r, skin), rtol=2e-4, atol=0)
    real = skin.mean_free_path
    mirrored = real + 4 * egan_A(skin.eta) * skin.D_classical
    for share in (0.5, 0.9, 0.99):
        left = 0.0
        for z in (real, mirrored):
            d = torch.hypot(profile.radius(share), z)
            left = left + skin.albedo_prime / 2 * z / d * torch.exp(-skin.sigma_tr_classical * d)
        torch.testing.assert_close(left, (1 - share) * profile.total, rtol=1e-4, atol=0)


def test_what_passes_a_slab_at_a_distance():
    """T(r) against 40 poles; what is left of the rows of poles is 1e-9 of the light."""
    slab = Stack([Layer(Medium(0.05, [1.0, 1.4, 2.0], 0.0, 1.4), 1.5)])
    profile = RadialProfile(slab, model="multipole", side="transmittance")
    r = torch.tensor([0.01, 0.3, 2.0, 6.0], dtype=torch.float64)
    rows = [Row(0.05, sigma_s, 1.5, eta=1.4) for sigma_s in (1.0, 1.4, 2.0)]
    T = np.stack([multipole.at_distance(row, r.numpy())[1] for row in rows], 1)
    np.testing.assert_allclose(profile.evaluate(r), T, rtol=1e-5, atol=1e-8)
    torch.testing.assert_close(
        profile.total, hankel_profiles(slab, torch.zeros(1), model="multipole")[1][0], check_dtype=False
    )


def test_maps_are_no_single_profile():
    with pytest.raises(DomainError, match=r"uniform material, got maps of \(2, 3\); take the mean"):
        RadialProfile(Layer(preset("skin1"), torch.rand(2, 3)))


def test_a_sum_of_many_gaussians_is_the_profile():
    """20 terms; the radii of eight are 7 to 32 % short where little is absorbed."""
    stack = Stack([Layer(preset("skin1"), 0.3), Layer(preset("cream"))])
    profile = RadialProfile(stack, model="layered-sp3")
    fitted = fit_gaussians(stack, terms=20)
    torch.testing.assert_close(fitted.total, profile.total, rtol=1e-6, atol=0)
    torch.testing.assert_close(fitted.radius(0.9), profile.radius(0.9), rtol=5e-3, atol=0)
    r = torch.tensor([0.3, 1.0, 4.0], dtype=torch.float64)
    torch.testing.assert_close(fitted.evaluate(r), profile.evaluate(r), rtol=2e-2, atol=0)


def test_no_light_goes_nowhere():
    assert not RadialProfile(Medium(1.0, 0.0), model="layered-sp3").radius().any()

"""Where the light comes from, as cosines inside."""

import math

from texsss.profiles.incidence import incidence_directions, mean_direction


def test_directions_of_diffuse_light():
    """Means of the cosine inside: 2/3 without refraction, .865 at eta 1.4; shares sum to 1."""
    assert abs(mean_direction("diffuse", 1.0)[0][0] - 2 / 3) < 1e-6
    assert abs(mean_direction("diffuse", 1.4)[0][0] - 0.865) < 1e-3
    for eta in (1.0, 1.1, 1.5):
        shares = [share for _, share in incidence_directions("diffuse", eta)]
        assert len(shares) > 1 and abs(sum(shares) - 1) < 1e-12
    ((cosine, _),) = incidence_directions(math.pi / 4, 1.5)
    assert abs(cosine - math.sqrt(1 - 0.5 / 2.25)) < 1e-12

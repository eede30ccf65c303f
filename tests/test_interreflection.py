"""Parts of an object that light each other, through the whole pipeline: an integrating sphere is a series."""

import pytest
import torch
from charted_shapes import sphere
from test_estimate import obj

from texsss.baker import Baker
from texsss.errors import DomainError
from texsss.scene import Scene
from texsss.surface.mesh import Mesh


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> dict:
    """A hollow sphere of 40 mm, lit by a lamp in its middle."""
    ball = sphere(12, 24, radius=40.0)
    inside = Mesh(ball.vertices, ball.faces.flip(1), ball.source_uv.flip(1))
    lamp = {"type": "point", "position_mm": [0, 0, 0], "intensity_w_per_sr": [1e-3] * 3}
    return {
        "mesh": {"source": obj(tmp_path_factory.mktemp("room") / "room.obj", inside), "unit_mm": 1},
        "atlas": {"size": 32},
        "media": {"wall": {"sigma_a_per_mm": [0.1, 0.02, 0.5], "sigma_s_per_mm": [5, 6, 4], "eta": 1.0}},
        "material": {"layers": [{"medium": "wall"}], "surface": {"specular": 0.0}},
        "lights": [lamp],
        "camera": {"position_mm": [0, 0, 30], "target_mm": [0, 0, -40], "resolution": [24, 18], "samples": 1},
    }


def test_an_integrating_sphere_sums_a_geometric_series(room):
    """E (1 + R + R² + …): exact for every number of bounces, as all of the wall sees all of it alike."""
    baker = Baker()
    bakes = [
        baker.bake(Scene.parse(room | {"methods": {"diffusion": "none", "interreflection": n}}))
        for n in (0, 1, 2, 5)
    ]
    returned = bakes[0].weights.total[0]
    direct = bakes[0].texel_irradiance.mean(0)
    for n, baked in zip((0, 1, 2, 5), bakes, strict=True):
        series = sum(returned**k for k in range(n + 1))
        # the flat walls of the mesh are lit unevenly by 2 %: measured 1.3e-3
        torch.testing.assert_close(baked.texel_irradiance.mean(0) / direct, series, rtol=3e-3, atol=0)
        assert baked.report["scene"]["methods"]["interreflection"] == n
    # and the energy that leaves is what entered, times what comes back
    torch.testing.assert_close(
        bakes[-1].texel_exitance.mean(0), returned * bakes[-1].texel_irradiance.mean(0), rtol=1e-3, atol=0
    )


def test_marched_pictures_keep_what_other_parts_send(room):
    """No march sees it: its single scattering stays diffused. Where light and eye are one they agree."""
    baker = Baker()

    def mean(single: str, bounces: int) -> torch.Tensor:
        methods = {"diffusion": "uv", "terms": 2, "single_scattering": single, "interreflection": bounces}
        return baker.render(Scene.parse(room | {"methods": methods})).mean((0, 1))

    added = [mean(single, 3) - mean(single, 0) for single in ("none", "exact")]
    assert float(added[0].min()) > 0
    torch.testing.assert_close(added[1], added[0], rtol=1e-4, atol=0)


@pytest.mark.parametrize("methods", [{"diffusion": "octree"}, {"diffusion": "parallax"}])
def test_methods_that_hear_no_echo_say_so(methods):
    with pytest.raises(DomainError, match="choose surface or uv to have parts light each other"):
        Scene.parse({"methods": methods | {"interreflection": 1}})


@pytest.mark.parametrize("bounces", [-1, 17, 1.5, "many"])
def test_bounces_are_counted(bounces):
    with pytest.raises(DomainError, match="interreflection"):
        Scene.parse({"methods": {"interreflection": bounces}})

"""Light by its angle through the whole pipeline: a sheet shows the product of both directions' shares."""

import math

import pytest
import torch
from charted_shapes import sheet
from test_estimate import obj

from texsss.baker import Baker
from texsss.errors import DomainError
from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.profiles.angular import angular
from texsss.scene import Scene

SUN, EYE = 1.2, 0.7  # from the normal [rad]


@pytest.mark.parametrize("eta", [1.0, 1.3])
def test_a_sheet_shows_both_directions(tmp_path, eta):
    """All but what is marched is e(μ) e(μ') times what it is when light enters and leaves evenly, + b b'."""
    baker, known = Baker(), preset("skin1")
    source = {"source": obj(tmp_path / "sheet.obj", sheet(2, 100.0, 100.0)), "unit_mm": 1}
    far = [50 + 5000 * math.sin(EYE), 50, 5000 * math.cos(EYE)]
    scene = {
        "mesh": source,
        "atlas": {"size": 16},
        "media": {
            "plain": {
                "sigma_a_per_mm": known.sigma_a.tolist(),
                "sigma_s_per_mm": known.sigma_s.tolist(),
                "eta": eta,
            }
        },
        "material": {"layers": [{"medium": "plain"}], "surface": {"specular": 0.0}},
        "lights": [{"type": "directional", "direction": [math.sin(SUN), 0, math.cos(SUN)]}],
        "camera": {
            "position_mm": far,
            "target_mm": [50, 50, 0],
            "fov_y_deg": 1,
            "resolution": [4, 3],
            "samples": 1,
        },
    }

    def shown(on: bool, **methods) -> torch.Tensor:
        how = {"diffusion": "none", "single_scattering": "exact", "angular": on} | methods
        given = Scene.parse(scene | {"methods": how})
        return (baker.render(given) - baker.intermediate(given, "single"))[1, 1]

    made = angular(Stack([Layer(Medium(known.sigma_a, known.sigma_s, 0.0, eta))]))
    cosines = torch.tensor([math.cos(SUN), math.cos(EYE)])
    both = made.at(cosines).prod(0)
    if made.beside is not None:
        lit = 3 * math.cos(SUN) / math.pi  # what a white sheet would show
        both = both + made.beside_at(cosines).prod(0) * lit / shown(False)
    torch.testing.assert_close(shown(True) / shown(False), both, rtol=2e-3, atol=0)  # the eye is near
    assert float((both - 1).abs().max()) > 0.01
    even = [baker.bake(Scene.parse(scene | {"methods": {"angular": on}})) for on in (True, False)]
    assert torch.equal(*(one.texel_exitance for one in even))  # textures know no eye
    assert not torch.equal(*(one.picture for one in even))


@pytest.mark.parametrize("diffusion", ["octree", "parallax"])
def test_methods_without_angles_say_so(diffusion):
    with pytest.raises(DomainError, match="angular: expected false"):
        Scene.parse({"methods": {"diffusion": diffusion, "angular": True}})

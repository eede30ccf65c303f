"""Scenes to tensors: what maps of different sizes come to."""

import pytest
import torch

from texsss import resolve
from texsss.errors import DomainError
from texsss.media.stack import Layer, Stack
from texsss.scene import Scene


def test_a_mask_may_be_finer_than_the_maps_it_mixes():
    """As thickness maps may: all are looked up as if on their own."""
    scene = Scene.parse(
        {
            "maps": {
                name: {"source": {"path": f"{name}.png"}, "space": "linear"} for name in ("spots", "mask")
            },
            "media": {
                "painted": {
                    "sigma_a_per_mm": 0.1,
                    "sigma_s_per_mm": {"map": "spots", "range": [1, 3]},
                    "eta": 1.3,
                }
            },
            "material": {"layers": [{"medium": {"mix": ["skin1", "painted"], "mask": "mask"}}]},
        }
    )
    rng = torch.Generator().manual_seed(0)
    images = {"spots": torch.rand(4, 4, 1, generator=rng), "mask": torch.ones(8, 8, 1)}
    uv = torch.tensor([[1.5 / 8, 2.5 / 8], [6.5 / 8, 0.5 / 8]])  # centres of the mask's texels
    spots = resolve.medium(scene, "painted", images)
    expected = Stack(Layer(spots)).at(uv).sigma_s[..., 0, 0]
    found = resolve.stack(scene, images).at(uv).sigma_s[..., 0, 0]
    torch.testing.assert_close(found, expected, check_dtype=False)


def test_a_medium_that_cannot_be_is_named():
    painted = {"map": "spots", "range": [0, 1e6]}
    scene = Scene.parse(
        {
            "maps": {"spots": {"source": {"path": "spots.exr"}}},
            "media": {"ink": {"sigma_a_per_mm": painted, "sigma_s_per_mm": 1.0}},
            "material": {"layers": [{"medium": "ink"}]},
        }
    )
    with pytest.raises(DomainError, match=r"media\.ink: Medium\.sigma_a: expected at most 1e\+06"):
        resolve.stack(scene, {"spots": torch.full((2, 2, 1), 5.0)})

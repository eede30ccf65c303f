"""What users may pass to the march: it answers with numbers, or with a sentence that helps."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from texsss.errors import Cancelled, DomainError, ShapeError
from texsss.light.emitters import DirectionalLight, PointLight
from texsss.light.visibility import Occluder
from texsss.media.depths import check_images
from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.transport.march.check import check_method, check_points, check_view
from texsss.transport.march.interior import from_depths, from_stack
from texsss.transport.march.march import March, march
from texsss.transport.march.noise import Noise
from texsss.transport.march.planes import Planes
from texsss.types import unit

MEDIUM = Medium([0.6, 0.5, 0.4], [2.0, 1.0, 1.0], 0.25)
SUN = [DirectionalLight([-0.3, 0.8, 0.6], [1.0, 1.0, 1.0])]


def square() -> Mesh:
    corners = torch.tensor([[-50.0, 0, 50], [50, 0, 50], [50, 0, -50], [-50, 0, -50]])
    uv = torch.tensor([[0.0, 1], [1, 1], [1, 0], [0, 0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    return Mesh(corners, faces, uv[faces])


def centre(count: int = 1) -> Points:
    return Points(torch.zeros(count, dtype=torch.long), torch.full((count, 3), 1 / 3))


def seen_from(*direction: float) -> torch.Tensor:
    return unit(torch.tensor([direction], dtype=torch.float32))


def test_depths_that_decrease_are_named_and_sorted_only_on_request():
    depth = torch.full((4, 4, 3), 0.5)
    depth[..., 1], depth[..., 2] = 0.8, 0.7
    with pytest.raises(DomainError, match=r"channel 2 to lie below channel 1.*sort=True"):
        from_depths(depth, [MEDIUM] * 3)
    tidy = from_depths(depth, [MEDIUM] * 3, sort=True)
    assert tidy.depth[0, 0].tolist() == pytest.approx([0.5, 0.7, 0.8])


def test_three_channels_are_three_layers_and_eight_are_eight():
    assert from_depths(torch.rand(4, 4, 3).cumsum(-1), [MEDIUM] * 3).layers == 3
    two = [torch.full((4, 4, 4), 0.1).cumsum(-1), torch.full((4, 4, 4), 0.1).cumsum(-1) + 0.4]
    assert from_depths(two, [MEDIUM] * 8).layers == 8
    infinite = from_depths(two, [MEDIUM] * 9)
    assert infinite.bottomless
    assert bool(torch.isfinite(march(centre(), square(), None, infinite, SUN, seen_from(0.2, 1, 0))).all())


def test_numbers_of_media_and_sizes_must_fit():
    with pytest.raises(ShapeError, match="4 media for 4 channels"):
        from_depths(torch.rand(4, 4, 4).cumsum(-1), [MEDIUM] * 3)
    with pytest.raises(ShapeError, match="of one size"):
        from_depths([torch.zeros(4, 4, 4), torch.zeros(8, 8, 4)], [MEDIUM] * 8)
    with pytest.raises(ShapeError, match="none"):
        from_depths([], [MEDIUM])
    for most in (-1.0, math.nan, [1.0, 2.0]):
        with pytest.raises(DomainError, match=r"most_mm as one number >= 0 .* each of 4 channels"):
            from_depths(torch.rand(4, 4, 4).cumsum(-1), [MEDIUM] * 4, most_mm=most)
    with pytest.raises(ShapeError, match="one thickness for all channels"):
        from_stack(Stack([Layer(MEDIUM, [0.1, 0.2, 0.3])]))


@pytest.mark.parametrize("value", [math.nan, -0.1, math.inf])
def test_depths_must_be_depths(value):
    with pytest.raises(DomainError, match="Depth texture"):
        from_depths(torch.full((2, 2, 1), value), [MEDIUM])


def test_bright_can_mean_shallow_and_depths_can_be_clamped():
    painted = torch.tensor([0.9, 0.5, 0.2]).expand(2, 2, 3)
    read = from_depths(painted, [MEDIUM] * 3, scale_mm=2.0, invert=True, most_mm=[9.0, 9.0, 1.2])
    assert read.depth[0, 0].tolist() == pytest.approx([0.2, 1.0, 1.2])
    with pytest.raises(DomainError, match="to invert"):
        from_depths(painted * 2, [MEDIUM] * 3, invert=True)


@pytest.mark.parametrize("direction", [(1, 0, 0), (0.7, -0.7, 0), (0, -1, 0)])
def test_eyes_at_or_below_the_horizon_see_nothing(direction):
    lit = march(centre(), square(), None, Stack([Layer(MEDIUM)]), SUN, seen_from(*map(float, direction)))
    assert lit.tolist() == [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize("cosine", [1e-9, 1e-4, 0.01, 0.05])
@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_grazing_light_and_grazing_eyes_stay_finite(cosine, eta):
    medium = Medium([0.6, 0.5, 0.4], [2.0, 1.0, 1.0], 0.9, eta)
    grazing = (math.sqrt(1 - cosine**2), cosine, 0.0)
    for eye, sun in ((grazing, (0.0, 1.0, 0.0)), ((0.0, 1.0, 0.0), grazing), (grazing, grazing)):
        lit = march(
            centre(),
            square(),
            None,
            Stack([Layer(medium, 1.0)]),
            [DirectionalLight(sun, [1.0] * 3)],
            seen_from(*eye),
        )
        assert bool(torch.isfinite(lit).all()) and float(lit.min()) >= 0 and float(lit.max()) < 1


@pytest.mark.parametrize(
    "position", [(0.0, -5.0, 0.0), (0.0, -0.5, 0.0), (0.0, 0.0, 0.0), (0.0, 1e-7, 0.0), (3.0, -1e4, 0.0)]
)
@pytest.mark.parametrize("shadows", [True, False])
def test_lights_inside_and_behind_give_numbers(position, shadows):
    mesh = square()
    occluder = Occluder(mesh) if shadows else None
    light = [PointLight(list(position), [1e-6] * 3)]
    for eta in (1.0, 1.4):
        medium = Medium(MEDIUM.sigma_a, MEDIUM.sigma_s, 0.2, eta)
        lit = march(
            centre(), mesh, None, Stack([Layer(medium, 1.0)]), light, seen_from(0.1, 1, 0), occluder=occluder
        )
        assert bool(torch.isfinite(lit).all())
        if position[1] < -1:
            assert float(lit.abs().max()) == 0


@pytest.mark.parametrize("compiled", [False, True])
def test_eyes_and_coordinates_of_another_precision_are_taken_over(compiled):
    """Cameras stand in float64, meshes in float32: what is marched has one precision."""
    mesh, eye, stack = (
        square(),
        torch.tensor([3.0, 40.0, 9.0]),
        Stack([Layer(MEDIUM, torch.rand(8, 8) + 0.1)]),
    )
    noise = Noise(uv=0.01, start=0.5)
    how = {"method": "uniform", "samples": 5, "noise": noise, "compiled": compiled}
    plain = march(centre(40), mesh, None, stack, SUN, eye, **how)
    assert mesh.source_uv is not None
    other = march(centre(40), mesh, None, stack, SUN, eye.double(), uv=mesh.source_uv.double(), **how)
    assert other.dtype == torch.float32
    assert torch.equal(other, plain)


def test_coordinates_that_are_no_numbers_are_refused():
    mesh, stack = square(), Stack([Layer(MEDIUM, torch.rand(8, 8))])
    assert mesh.source_uv is not None
    broken = mesh.source_uv.clone()
    broken[0, 0] = math.nan
    with pytest.raises(DomainError, match="finite texture coordinates"):
        march(centre(), mesh, None, stack, SUN, seen_from(0, 1, 0), uv=broken)
    with pytest.raises(DomainError, match="finite texture coordinates"):
        Mesh(mesh.vertices, mesh.faces, broken)
    with pytest.raises(DomainError, match="finite texture"):
        Noise(uv=0.1, texture=torch.full((2, 2), math.nan))


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("width", [1e-5, 1e-9])
def test_a_face_too_thin_for_its_texture_gives_numbers(width, compiled):
    """Texels so small that float32 cannot count them: any of them will do, but none beyond the texture."""
    corners = torch.tensor([[0.0, 0, 0], [width, 0, 0], [0, 0, -10]])
    mesh = Mesh(corners, torch.tensor([[0, 1, 2]]), torch.tensor([[[0.0, 1], [1, 1], [0, 0]]]))
    depth = from_depths(
        torch.rand(100, 100, 2, generator=torch.Generator().manual_seed(0)).cumsum(-1), [MEDIUM] * 2
    )
    lit = march(centre(64), mesh, None, depth, SUN, seen_from(0.5, 0.7, 0.2).expand(64, 3), compiled=compiled)
    assert bool(torch.isfinite(lit).all()) and float(lit.max()) < 1


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("phase", ["henyey-greenstein", "schlick"])
@pytest.mark.parametrize("g", [0.9999, 0.99999, -0.9995, -0.9999])
def test_the_sharpest_phase_functions_stay_finite(g, phase, compiled):
    """Nothing from a light behind; towards the light, what float64 says (rounding of g: measured 3e-3)."""

    def seen(eye, sun, dtype, **how):
        mesh, light = square(), [DirectionalLight(list(sun), [1.0] * 3)]
        mesh = Mesh(mesh.vertices.to(dtype), mesh.faces)
        medium = Medium(MEDIUM.sigma_a, MEDIUM.sigma_s, g)
        view = seen_from(*eye).to(dtype)
        return march(centre(), mesh, None, Stack([Layer(medium)]), light, view, phase=phase, **how)

    assert float(seen((0, 1, 0), (0, -1, 0), torch.float32, compiled=compiled).abs().max()) == 0
    lit = seen((0, 1, 0), (0, 1, 0), torch.float32, compiled=compiled)
    truth = seen((0, 1, 0), (0, 1, 0), torch.float64)
    torch.testing.assert_close(lit.double(), truth, rtol=2e-2, atol=0)


def test_one_sample_and_ten_thousand():
    stack = Stack([Layer(MEDIUM, 1.0)])
    exact = march(centre(), square(), None, stack, SUN, seen_from(0.3, 1, 0))
    for method in ("exact", "uniform"):
        one = march(centre(), square(), None, stack, SUN, seen_from(0.3, 1, 0), method=method, samples=1)
        assert bool(torch.isfinite(one).all())
    how = {"method": "uniform", "samples": 10_000, "compiled": True}
    many = march(centre(), square(), None, stack, SUN, seen_from(0.3, 1, 0), **how)
    torch.testing.assert_close(many, exact, rtol=1e-3, atol=0)
    for samples in (0, 10_001, -3):
        with pytest.raises(DomainError, match="samples"):
            march(centre(), square(), None, stack, SUN, seen_from(0.3, 1, 0), samples=samples)


def test_layers_deeper_than_the_object_are_as_good_as_infinite():
    view = seen_from(0.3, 1, 0)
    deep, endless = (
        march(centre(), square(), None, Stack([Layer(MEDIUM, d)]), SUN, view) for d in (1e6, None)
    )
    torch.testing.assert_close(deep, endless, rtol=1e-5, atol=0)


def test_clear_and_absent_media_scatter_nothing():
    clear = Medium(0.0, 0.0)
    for layers in ([Layer(clear)], [Layer(clear, 0.0)], [Layer(MEDIUM, 0.0)], [Layer(Medium(1.0, 0.0), 2.0)]):
        lit = march(centre(), square(), None, Stack(layers), SUN, seen_from(0.3, 1, 0))
        assert float(lit.abs().max()) == 0


def test_no_lights_no_points_no_maps_without_coordinates():
    stack = Stack([Layer(MEDIUM)])
    assert float(march(centre(), square(), None, stack, [], seen_from(0, 1, 0)).abs().max()) == 0
    nobody = Points(torch.zeros(0, dtype=torch.long), torch.zeros(0, 3))
    assert march(nobody, square(), None, stack, SUN, torch.tensor([0.0, 9, 0])).shape == (0, 3)
    bare = Mesh(square().vertices, square().faces)
    assert bool((march(centre(), bare, None, stack, SUN, seen_from(0, 1, 0)) > 0).all())
    with pytest.raises(DomainError, match="texture coordinates"):
        march(centre(), bare, None, from_depths(torch.rand(2, 2, 1), [MEDIUM]), SUN, seen_from(0, 1, 0))


def test_names_and_shapes_are_checked():
    stack = Stack([Layer(MEDIUM)])
    with pytest.raises(ShapeError, match="view direction per point"):
        march(centre(2), square(), None, stack, SUN, torch.zeros(5, 3))
    for length in (0.0, 5.0):
        with pytest.raises(DomainError, match=f"got lengths from {length:g} to {length:g}; divide"):
            march(centre(), square(), None, stack, SUN, length * seen_from(0, 1, 0))
    with pytest.raises(ShapeError, match="a plane for each of 4 vertices, got 1;"):
        march(centre(), square(), Planes(torch.ones(1, 3), torch.ones(1)), stack, SUN, seen_from(0, 1, 0))
    with pytest.raises(ShapeError, match=r"texture coordinates \(2, 3, 2\), one per face corner of mesh"):
        march(centre(), square(), None, stack, SUN, seen_from(0, 1, 0), uv=torch.rand(5, 3, 2))
    with pytest.raises(DomainError, match="finite eye"):
        march(centre(), square(), None, stack, SUN, torch.tensor([math.nan, 0, 0]))
    with pytest.raises(DomainError, match="per light"):
        march(centre(), square(), None, stack, SUN, seen_from(0, 1, 0), environment_samples=0)
    for wrong, named in (
        ([], "each of 1 lights, got 0"),
        ([None] * 2, "each of 1 lights, got 2"),
        ([torch.ones(2, 3)], r"expected what entered as \(1, 3\), got shape \(2, 3\)"),
    ):
        with pytest.raises(ShapeError, match=named):
            March(square(), None, stack, SUN)(centre(), torch.tensor([0.0, 500, 0]), entered=wrong)
    with pytest.raises(DomainError, match="Noise"):
        Noise(uv=-1.0)
    with pytest.raises(Cancelled):
        march(centre(), square(), None, stack, SUN, seen_from(0, 1, 0), cancel=lambda: True)


def test_what_types_do_not_hold_up_is_told_in_a_sentence():
    """Annotations are checked in tests alone: users meet these."""
    with pytest.raises(ShapeError, match=r"position of one eye \(3,\) or .* got shape \(2,\)"):
        check_view(1, torch.ones(2))
    for samples in (2.5, "4", 10_001):
        with pytest.raises(DomainError, match=f"1 to 10000 samples, got {samples!r}; 4 exact"):
            check_method("exact", samples, "schlick", 1, 1)
    for thickness, normals, name in ((torch.ones(3), None, "thickness"), (None, torch.ones(3, 3), "normals")):
        with pytest.raises(ShapeError, match=f"expected {name} of shape"):
            check_points(1, thickness, normals)
    for thickness, normals, name in ((torch.ones(1), None, "thickness"), (None, torch.ones(1, 3), "normals")):
        with pytest.raises(DomainError, match=f"expected numbers as {name}, got NaN"):
            check_points(1, *(None if one is None else one * math.nan for one in (thickness, normals)))
    for wrong, named in (
        (torch.rand(4, 4), r"images \(H, W, channels\), got shape \(4, 4\)"),
        (torch.zeros(0, 0, 4), r"got shape \(0, 0, 4\)"),
        ([[0.5]], "images as tensors"),
    ):
        with pytest.raises((ShapeError, DomainError), match=named):
            check_images([wrong])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    sigma=st.lists(st.floats(0, 1e3), min_size=4, max_size=4),
    g=st.floats(-0.99, 0.99),
    thickness=st.floats(0, 1e4),
    eye=st.tuples(*[st.floats(-1, 1)] * 3),
    sun=st.tuples(*[st.floats(-1, 1)] * 3),
    eta=st.sampled_from([1.0, 1.3, 2.0]),
    method=st.sampled_from(["exact", "uniform"]),
    phase=st.sampled_from(["henyey-greenstein", "schlick"]),
)
def test_never_nan_never_negative(sigma, g, thickness, eye, sun, eta, method, phase):
    sun, eye = (one if max(map(abs, one)) >= 1e-3 else (0.0, 1.0, 0.0) for one in (sun, eye))
    layers = [
        Layer(Medium(sigma[0], sigma[1], g, eta), thickness),
        Layer(Medium(sigma[2], sigma[3], -g, eta)),
    ]
    light = [DirectionalLight(list(sun), [1.0] * 3)]
    lit = march(
        centre(),
        square(),
        None,
        Stack(layers),
        light,
        unit(torch.tensor([eye])),
        method=method,
        phase=phase,
        samples=3,
    )
    assert bool(torch.isfinite(lit).all()) and float(lit.min()) >= 0

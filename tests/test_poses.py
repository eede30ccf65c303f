"""Meshes in poses: what is kept, what is redone, and that a pose is the mesh it bends to."""

import json
import math
from itertools import pairwise
from pathlib import Path

import pytest
import torch

from texsss.baker import Baker
from texsss.cli import main
from texsss.errors import AssetError, DomainError, ShapeError
from texsss.io.images import write_png
from texsss.io.meshes import read_mesh, read_positions
from texsss.io.sandbox import Sandbox
from texsss.light.irradiance import irradiance
from texsss.light.visibility import Occluder
from texsss.pipeline import Run
from texsss.placing import lights
from texsss.scene import Scene
from texsss.surface.pose import Pose, doubts_of, stretch
from texsss.transport.bank import build_bank, exitance
from texsss.transport.march.interior import from_stack
from texsss.transport.march.march import fitted_planes, planes_radius

LAMP = {"type": "point", "position_mm": [200.0, 150.0, 250.0], "intensity_w_per_sr": [1.0, 1.0, 1.0]}
CAMERA = {
    "position_mm": [0.0, 120.0, 300.0],
    "target_mm": [0.0, 0.0, 0.0],
    "resolution": [48, 36],
    "samples": 1,
}


@pytest.fixture(scope="module")
def baker() -> Baker:
    return Baker()


@pytest.fixture(scope="module")
def scene(small) -> Scene:
    return Scene.parse({**small, "lights": [LAMP], "camera": CAMERA, "atlas": {"size": 64}})


@pytest.fixture(scope="module")
def rest(baker, scene) -> torch.Tensor:
    return baker.mesh(scene).vertices


def bent(rest: torch.Tensor, by: float = 0.004) -> torch.Tensor:
    """A ring that is bent upwards on both sides."""
    return torch.stack([rest[:, 0], rest[:, 1] + by * rest[:, 0] ** 2, rest[:, 2]], -1)


def relative(one: torch.Tensor, other: torch.Tensor) -> float:
    return float((one - other).norm() / other.norm())


def test_the_rest_pose_is_the_bake_itself(baker, scene, rest):
    plain, posed = baker.bake(scene), baker.bake(scene, pose=Pose(rest))
    assert torch.equal(plain.exitance, posed.exitance) and torch.equal(plain.picture, posed.picture)
    assert plain.report["pose"] is None
    assert posed.report["pose"] == {"operators": "rest", "stretch": 0.0}


def test_a_pose_redoes_what_depends_on_it_and_nothing_else(baker, scene, rest):
    baker.bake(scene).picture  # noqa: B018
    posed = baker.bake(scene, pose=Pose(bent(rest, 0.001)))
    posed.picture  # noqa: B018
    assert set(posed.report["seconds"]) == {
        *("pose", "texels", "sites", "occluder", "light", "bank", "exitance", "planes", "sights", "picture")
    }


def test_refreshing_operators_is_a_step_of_its_own(baker, scene, rest):
    first = baker.bake(scene, pose=Pose(bent(rest)))
    again = baker.bake(scene, pose=Pose(bent(rest), operators="pose"))
    assert {"operators", "bank", "exitance"} <= set(again.report["seconds"])
    assert not {"light", "texels", "planes"} & set(again.report["seconds"])
    assert again.report["pose"]["operators"] == "pose"
    # measured 2.3e-2, of a stretch of .17
    assert 1e-3 < relative(first.texel_exitance, again.texel_exitance) < 4e-2
    said = [[n for n in one.report["notes"] if "stretches the surface" in n] for one in (first, again)]
    assert len(said[0]) == 1 and not said[1]


def test_a_rigid_motion_changes_nothing_where_lights_and_camera_follow(baker, scene, rest):
    turn = torch.linalg.qr(
        torch.randn(3, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    )[0]
    turn, shift = (turn * torch.linalg.det(turn)).float(), torch.tensor([30.0, -20.0, 50.0])
    moved = lambda place: (torch.tensor(place) @ turn.T + shift).tolist()  # noqa: E731
    follows = Scene.parse(
        scene.model_dump(mode="json") | {"lights": [{**LAMP, "position_mm": moved(LAMP["position_mm"])}]}
    )
    plain = baker.bake(scene)
    posed = baker.bake(follows, pose=Pose(rest @ turn.T + shift))
    # float32 positions; shadow rays of single texels at terminators: measured 1.7e-4
    assert relative(posed.texel_exitance, plain.texel_exitance) < 5e-4
    assert posed.report["pose"]["stretch"] < 1e-5


@pytest.fixture(scope="module")
def bent_file(small, rest, tmp_path_factory):
    """The torus' file with its vertices bent, which is another mesh to a baker."""
    path = tmp_path_factory.mktemp("bent") / "bent.obj"
    lines = Path(small["mesh"]["source"]).read_text().splitlines()
    numbers = [i for i, line in enumerate(lines) if line.startswith("v ")]
    for i, place in zip(numbers, bent(rest).double().tolist(), strict=True):
        lines[i] = "v " + " ".join(map(repr, place))
    path.write_text("\n".join(lines))
    return path


def test_a_pose_is_a_fresh_bake_of_the_bent_mesh(baker, scene, rest, bent_file):
    """Light to rounding; exitance too where operators are refreshed and the ladder is that of rest."""
    data = scene.model_dump(mode="json")
    fresh = baker.bake(Scene.parse(data | {"mesh": {"source": str(bent_file), "unit_mm": 1.0}}))
    kept, refreshed = (baker.bake(scene, pose=Pose(bent(rest), operators=of)) for of in ("rest", "pose"))
    on = fresh.texels.covered
    assert torch.equal(fresh.texels.index[on], kept.texels.index[kept.texels.covered])
    assert relative(kept.texel_irradiance[on], fresh.texel_irradiance[on]) < 1e-6
    ladder = refreshed.weights.variances
    bank = build_bank(refreshed.texel_irradiance, refreshed.texels, ladder, method="surface")
    albedo = baker.intermediate(scene, "albedo")
    anew = exitance(bank, refreshed.weights) * refreshed.texels.from_image(albedo)
    assert relative(refreshed.texel_exitance[on], anew[on]) < 1e-6
    # the ladder follows texels and extent: the same profile by other Gaussians
    assert relative(refreshed.texel_exitance[on], fresh.texel_exitance[on]) < 5e-3
    assert relative(kept.texel_exitance[on], fresh.texel_exitance[on]) < 4e-2


def test_light_and_planes_are_of_the_pose(baker, scene, rest):
    run = Run(baker.cache, scene, pose=Pose(bent(rest)))
    mesh, radius = baker.mesh(scene).moved(bent(rest)), planes_radius(from_stack(run.stack.value))
    fitted = fitted_planes(mesh, radius)
    for field in ("normal", "offset"):
        assert torch.equal(getattr(run.planes.value, field), getattr(fitted, field))
    at_rest = Run(baker.cache, scene).planes.value
    assert float((fitted.normal - at_rest.normal).abs().max()) > 0.1
    eta, lamps = run.stack.value.eta, lights(scene, mesh, {})
    lit = irradiance(run.texels.value.points, mesh, lamps, eta=eta, occluder=Occluder(mesh))
    assert torch.equal(run.irradiance.value, lit)


def test_poses_are_not_taken_for_each_other_and_memory_does_not_grow(scene, rest):
    baker = Baker(cache_bytes=32 << 20)
    plain = baker.bake(scene)
    assert plain.picture is not None
    held, shown = [], []
    for k in [*range(8), 3]:
        baked = baker.bake(scene, pose=Pose(bent(rest, 0.0005 * k)))
        shown.append(baked.picture)
        held.append(baker.cache.bytes_passing)
        assert not {"operators", "weights", "atlas", "doubts"} & set(baked.report["seconds"])
    assert 2 << 20 < max(held) <= 4 << 20 and held[-1] == pytest.approx(held[-2], rel=0.3)
    assert torch.equal(shown[3], shown[-1])
    assert all(relative(a, b) > 1e-3 for a, b in pairwise(shown))
    assert not set(baker.bake(scene).report["seconds"])
    assert torch.equal(baker.bake(scene).texel_exitance, plain.texel_exitance)


def test_a_pose_of_painted_matter_reads_its_maps_as_at_rest(baker, small, rest, tmp_path):
    """What lies across seams is looked for once; a scene's own pose is kept as anything else."""
    write_png(tmp_path / "spots.png", torch.rand(16, 16, 3, generator=torch.Generator().manual_seed(0)))
    layers = [
        {"medium": "skin1", "thickness_mm": {"map": "spots", "range": [0.1, 1.0]}},
        {"medium": "marble"},
    ]
    painted = Scene.parse(
        {**small, "lights": [LAMP], "camera": CAMERA, "atlas": {"size": 64}}
        | {"maps": {"spots": {"source": {"path": str(tmp_path / "spots.png")}, "channel": "r"}}}
        | {"material": {"layers": layers}}
    )
    assert "seams" in _stages(baker, painted, None)
    assert not {"seams", "maps"} & _stages(baker, painted, Pose(bent(rest, 0.001)))


def _stages(baker: Baker, scene: Scene, pose: Pose | None) -> set[str]:
    baked = baker.bake(scene, pose=pose)
    baked.picture  # noqa: B018
    return set(baked.report["seconds"])


@pytest.mark.parametrize("diffusion", ["uv", "octree"])
def test_other_ways_to_spread_light_take_poses(baker, scene, rest, diffusion):
    """At rest they are the bake itself; light that a bend takes away is missed."""
    data = scene.model_dump(mode="json") | {
        "methods": {"diffusion": diffusion, "octree": {"spacing_mm": 16.0}}
    }
    other = Scene.parse(data)
    plain, same, moved = (baker.bake(other, pose=pose) for pose in (None, Pose(rest), Pose(bent(rest))))
    assert relative(same.texel_exitance, plain.texel_exitance) < 1e-6
    sums = [
        (one.texels.area @ values)
        for one in (plain, moved)
        for values in (one.texel_irradiance, one.texel_exitance)
    ]
    assert relative(sums[2], sums[0]) > 0.01
    torch.testing.assert_close(sums[3] / sums[2], sums[1] / sums[0], rtol=0.05, atol=0)


def test_stretch_of_known_poses(rest, baker, scene):
    mesh = baker.mesh(scene)
    assert stretch(mesh, mesh.moved(rest * 1.2)) == pytest.approx(math.log(1.2), rel=1e-5)
    assert stretch(mesh, mesh.moved(rest.flip(-1))) == pytest.approx(0, abs=1e-5)


def test_doubtful_poses_are_told(baker, scene, rest):
    mesh = baker.mesh(scene)
    told = [doubts_of(mesh, mesh.moved(rest * by), 0.0, True) for by in (1.0, torch.tensor([-1.0, 1, 1]))]
    assert not told[0] and "inside out" in told[1][0]
    shuffled = mesh.moved(rest[torch.randperm(len(rest), generator=torch.Generator().manual_seed(0))])
    assert "in the order of the mesh" in doubts_of(mesh, shuffled, stretch(mesh, shuffled), True)[0]
    assert "by 35%" in doubts_of(mesh, mesh, 0.3, True)[0] and not doubts_of(mesh, mesh, 0.3, False)


def test_gradients_pass_through_poses(baker, scene, rest):
    scale = torch.tensor(1.0, requires_grad=True)
    left = lambda by: baker.bake(scene, pose=Pose(rest * by)).texel_irradiance.sum()  # noqa: E731
    left(scale).backward()
    expected = (left(1.002) - left(0.998)) / 0.004
    assert scale.grad is not None
    torch.testing.assert_close(scale.grad, expected, rtol=0.02, atol=0)


def test_poses_that_are_none_are_told(baker, scene, rest):
    with pytest.raises(ShapeError, match=r"expected 1,152 vertices, as many as torus has, got 1,151"):
        baker.bake(scene, pose=Pose(rest[1:]))
    with pytest.raises(ShapeError, match=r"vertices of shape \(V, 3\) \[mm\], got \(1152, 2\)"):
        Pose(rest[:, :2])
    with pytest.raises(DomainError, match="NaN or infinity in 1 of"):
        baker.bake(scene, pose=Pose(torch.cat([rest[:-1], torch.full((1, 3), float("nan"))])))
    with pytest.raises(DomainError, match="numbers of 32 bits hold, got inf"):
        baker.bake(scene, pose=Pose(rest.double() * 1e60))
    with pytest.raises(DomainError, match="operators of rest or pose, got 'new'"):
        Pose(rest, operators="new")
    with pytest.raises(
        DomainError, match="expected vertices with an extent that numbers of 32 bits hold, got 0 mm"
    ):
        baker.bake(scene, pose=Pose(torch.zeros_like(rest)))


# one vertex that nothing uses, two that are there twice
SEAM = "v 0 0 0\nv 9 9 9\nv 1 0 0\nv 1 1 0\nv 0 0 0\nv 1 1 0\nv 0 1 0\nf 1 3 4\nf 5 6 7\n"


def test_vertices_count_as_in_the_file_or_as_in_the_mesh():
    mesh, notes = read_mesh(SEAM.encode(), unit_mm=10, up="z", name="seam.obj")
    assert len(mesh.vertices) == 4 and notes.vertices_in_file == 7
    positions, triangles = read_positions(SEAM.encode(), unit_mm=10, up="z", name="seam.obj")
    assert triangles.tolist() == [[0, 2, 3], [4, 5, 6]]
    posed = Pose(torch.from_numpy(positions) + 1).of(mesh, notes.vertices_in_file)
    torch.testing.assert_close(posed.vertices, mesh.vertices + 1)
    assert Pose(mesh.vertices).of(mesh, 7).vertices is not None
    with Sandbox() as box:
        assert box.read_mesh(SEAM.encode(), unit_mm=10)[0].source_vertex.tolist() == [0, 2, 3, 6]
        there, same = box.read_positions(SEAM.encode(), unit_mm=10, up="z", name="seam.obj")
    assert (same == triangles).all() and (there == positions).all()


def test_what_nothing_uses_may_be_anywhere():
    """At rest a vertex without a face is dropped before it is looked at; so it is in a pose."""
    lost = SEAM.replace("v 9 9 9", "v nan 9 9")
    mesh, notes = read_mesh(lost.encode(), unit_mm=10, name="seam.obj")
    positions, _ = read_positions(lost.encode(), unit_mm=10, name="seam.obj")
    assert math.isnan(positions[1, 0])
    assert torch.equal(Pose(torch.from_numpy(positions)).of(mesh, 7).vertices, mesh.vertices)
    positions[2, 0] = math.nan
    with pytest.raises(DomainError, match="NaN or infinity in 1 of 4; check"):
        Pose(torch.from_numpy(positions)).of(mesh, notes.vertices_in_file)
    with pytest.raises(AssetError, match="1 with NaN or infinity"):
        read_positions(SEAM.replace("v 1 0 0", "v nan 0 0").encode(), unit_mm=10, name="seam.obj")


def test_a_file_that_joins_its_vertices_otherwise_is_another_mesh(baker, scene, small, rest, tmp_path):
    """As many vertices and triangles do not make it the same; quads may be cut along either diagonal."""
    lines = Path(small["mesh"]["source"]).read_text().splitlines()
    places = [line for line in lines if line.startswith("v ")]
    quads = [[int(c.split("/")[0]) for c in line.split()[1:]] for line in lines if line.startswith("f ")]
    order = torch.randperm(len(rest), generator=torch.Generator().manual_seed(0)).tolist()

    def exitance(name: str, faces: list[tuple[int, ...]]) -> torch.Tensor:
        path = tmp_path / f"{name}.obj"
        path.write_text("\n".join(places + [f"f {' '.join(map(str, face))}" for face in faces]))
        data = scene.model_dump(mode="json")
        data["mesh"]["pose"] = {"source": {"path": str(path)}}
        return baker.bake(Scene.parse(data)).texel_exitance

    one = exitance("one", [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    other = exitance("other", [t for a, b, c, d in quads for t in ((b, c, d), (b, d, a))])
    assert torch.equal(one, other)
    with pytest.raises(AssetError, match=r"the triangles of torus, got others in shuffled.obj, which share"):
        exitance("shuffled", [tuple(order[i - 1] + 1 for i in quad) for quad in quads])


def test_scenes_and_the_command_line_name_a_file(scene, rest, baker, small, bent_file, tmp_path, capfd):
    data = {**small, "lights": [LAMP], "camera": CAMERA, "atlas": {"size": 64}}
    data["mesh"] = {**small["mesh"], "pose": str(bent_file)}
    before = baker.cache.bytes_passing
    (tmp_path / "scene.json").write_text(json.dumps(data))
    named = baker.bake(Scene.parse(data))
    assert baker.cache.bytes_passing == before  # a scene's own pose stays
    assert relative(named.texel_exitance, baker.bake(scene, pose=Pose(bent(rest))).texel_exitance) < 1e-6
    with pytest.raises(SystemExit) as stopped:
        main(["bake", str(tmp_path / "scene.json"), "--refresh-operators", "--out", str(tmp_path / "out")])
    assert stopped.value.code == 0, capfd.readouterr().err
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["pose"]["operators"] == "pose" and report["pose"]["stretch"] > 0.01
    bent_file.with_name("other.obj").write_text(SEAM)
    data["mesh"]["pose"] = {"source": {"path": str(bent_file.with_name("other.obj"))}}
    with pytest.raises(AssetError, match=r"the 1,152 vertices and 2,304 triangles of torus, got 7 and 2"):
        baker.bake(Scene.parse(data))
    with pytest.raises(SystemExit) as stopped:
        main(["bake", "--refresh-operators"])
    assert stopped.value.code == 2 and "name its file by --pose" in capfd.readouterr().err

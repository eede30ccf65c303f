"""GET /v1/presets, /v1/scenes, /v1/schema: what can be asked for."""

from fastapi import APIRouter, Request
from pydantic import BaseModel
from texsss_server.openapi import EXAMPLES, scene_schema
from texsss_server.problems import responses
from texsss_server.service import TheService

from texsss import gallery
from texsss.scene import Scene

router = APIRouter(responses=responses())


class Preset(BaseModel):
    """A medium by name; coefficients [1/mm] per RGB channel."""

    name: str
    sigma_a_per_mm: list[float]
    sigma_s_per_mm: list[float]
    g: list[float]
    eta: float
    mean_free_path_mm: list[float]


class ExampleScene(BaseModel):
    """A scene to start from."""

    name: str
    summary: str
    scene: dict


@router.get(
    "/v1/presets",
    summary="Media by name",
    responses=responses("starting", "stopping", "queue-full", "render-timeout"),
)
async def presets(request: Request, service: TheService) -> list[Preset]:
    """Every medium that a layer may name without defining it."""
    found = await service.run(request, lambda engine, turn: engine.presets())
    return [Preset(**one) for one in found]


@router.get("/v1/scenes", summary="Scenes to start from")
async def scenes() -> list[ExampleScene]:
    """Scenes that render as they are; the first is the default, every field stated."""
    shipped = {name: gallery.scene(name) for name in gallery.names()}
    named = {name: (one["summary"], Scene.parse(one["value"])) for name, one in EXAMPLES.items()}
    named |= {name: (scene.summary, scene) for name, scene in shipped.items()}
    return [
        ExampleScene(name=name, summary=summary, scene=_plain(scene))
        for name, (summary, scene) in named.items()
    ]


def _plain(scene: Scene) -> dict:
    """Every field stated but those that are None, of which none is the same as leaving it out."""
    return scene.model_dump(mode="json", exclude_none=True)


@router.get("/v1/schema", summary="JSON schema of a scene")
async def schema() -> dict:
    """The schema of the bodies that render, bake, profile and inspect take."""
    found = scene_schema()
    return found | {"$schema": "https://json-schema.org/draft/2020-12/schema"}

"""The description of the API: schemas of bodies that the routes read by themselves, examples that work."""

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from texsss_server.middleware import LOCKED
from texsss_server.problems import SCHEMA

from texsss.scene import Scene

REF = "#/components/schemas/{model}"

EXAMPLES: dict[str, dict[str, Any]] = {
    "default": {"summary": "The default scene", "value": {}},
    "small": {
        "summary": "A small, quick picture in marble",
        "value": {
            "material": {"layers": [{"medium": "marble"}]},
            "atlas": {"size": 128},
            "camera": {"resolution": [160, 120], "samples": 1},
        },
    },
    "layers": {
        "summary": "A thin layer of skin over a bloody one, a lamp at the side",
        "value": {
            "atlas": {"size": 128},
            "media": {
                "blood": {"sigma_a_per_mm": [0.6, 0.6, 0.6], "sigma_s_per_mm": [6, 3, 2], "g": 0.4},
            },
            "material": {"layers": [{"medium": "skin1", "thickness_mm": 0.5}, {"medium": "blood"}]},
            "lights": [{"type": "point", "position_mm": [300, 200, 100], "intensity_w_per_sr": [1, 1, 1]}],
            "camera": {"resolution": [160, 120], "samples": 1},
        },
    },
}


def scene_schema() -> dict[str, Any]:
    """The JSON schema of a scene as this service takes it: without files of the server."""
    schema = Scene.model_json_schema(ref_template=REF)
    source = schema["$defs"]["Source"]
    del source["properties"]["path"]
    source["description"] = "Where bytes come from: an upload (sha256) or a builtin asset, exactly one."
    return schema


SCENE_BODY = {
    "requestBody": {
        "required": True,
        "content": {
            "application/json": {"schema": {"$ref": REF.format(model="Scene")}, "examples": EXAMPLES}
        },
    }
}
"""Of routes that take a scene, for `openapi_extra`."""


def describe(app: FastAPI, needs_key: bool) -> dict[str, Any]:
    """The OpenAPI document, made once; it asks for a key where the service does."""
    if app.openapi_schema is None:
        document = get_openapi(
            title=app.title, version=app.version, description=app.description, routes=app.routes
        )
        schemas = document.setdefault("components", {}).setdefault("schemas", {})
        scene = scene_schema()
        schemas |= scene.pop("$defs") | {"Scene": scene, "Problem": SCHEMA}
        for unused in ("HTTPValidationError", "ValidationError"):
            schemas.pop(unused, None)
        _drop_framework_errors(document)
        if needs_key:
            document["components"]["securitySchemes"] = {"key": {"type": "http", "scheme": "bearer"}}
            for path, operations in document["paths"].items():
                for operation in operations.values() if path.startswith(LOCKED) else ():
                    operation["security"] = [{"key": []}]
        app.openapi_schema = document
    return app.openapi_schema


def _drop_framework_errors(document: dict[str, Any]) -> None:
    """Removes the 422 that the framework promises where a path has a parameter: any text is taken there."""
    for operations in document["paths"].values():
        for operation in operations.values():
            promised = str(operation["responses"].get("422", ""))
            if "HTTPValidationError" in promised:
                del operation["responses"]["422"]

"""What an operator may choose, by environment (TEXSSS_PORT=…) or command line."""

import os
import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError, field_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from texsss.errors import DomainError

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]
MB = 1 << 20
OTHERS = {"TEXSSS_CACHE_DIR", "TEXSSS_FUZZ_CASES", "TEXSSS_LOAD_S"}  # of the library, and of tests


class Settings(BaseSettings):
    """Every limit of the service. Sizes in MB, times in seconds."""

    model_config = SettingsConfigDict(env_prefix="TEXSSS_", frozen=True, extra="ignore")

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8000
    api_key: Annotated[str, Field(min_length=1)] | None = None
    """Asked for as `Authorization: Bearer KEY` under /v1 and /metrics; None leaves the door open."""
    allowed_hosts: Annotated[tuple[str, ...], NoDecode] = ("localhost", "127.0.0.1", "::1")
    """Names that Host may have; "*" allows all. In the environment: separated by spaces."""
    cors_origins: Annotated[tuple[str, ...], NoDecode] = ()
    log_format: Literal["json", "text"] = "json"

    threads: Count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    cache_mb: Positive = 2048
    """Results of stages."""
    answers_mb: Positive = 128
    """Encoded answers, which identical requests get again."""
    disk_mb: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 4096
    """Operators that outlast the service, in the user's cache folder (TEXSSS_CACHE_DIR); 0 keeps none."""
    warm: bool = True
    """Whether the default scene is made ready in the background."""

    queue: Count = 16
    """Requests that may wait for the render thread."""
    queue_wait_s: Positive = 0.25
    """How long a request waits for a place before 429: an instant 429 invites hammering."""
    render_timeout_s: Positive = 60
    job_timeout_s: Positive = 900
    job_ttl_s: Positive = 900
    """How long a finished job is kept."""
    jobs: Count = 32
    jobs_mb: Positive = 512
    """Results of jobs."""
    grace_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 20
    """How long work may go on after SIGTERM."""

    connections: Count = 1000
    """Open at a time, idle ones included."""
    header_timeout_s: Positive = 20
    read_timeout_s: Positive = 60
    """After which a client that takes nothing of its answer is left."""
    body_mb: Positive = 1
    body_timeout_s: Positive = 20
    upload_mb: Positive = 64
    upload_timeout_s: Positive = 120
    max_faces: Count = 1_000_000
    max_map_pixels: Count = 4096 * 4096
    max_scene_pixels: Count = 4 * 4096 * 4096
    """Of all uploaded maps of a scene together: 12 bytes each while it is baked; of those that go on across
    seams about 32, and 16 more of the one in hand."""
    parse_memory_mb: Positive = 1500
    parse_timeout_s: Positive = 10
    parse_queue: Count = 8
    uploads: Count = 16
    """Uploads that may arrive at once."""
    assets_mb: Positive = 2048
    assets_count: Count = 2000
    assets_dir: Path | None = None
    """Where uploads are kept; None is a temporary folder that goes with the process."""

    max_atlas: Count = 2048
    max_picture_pixels: Count = 4_000_000
    max_rays: Count = 40_000_000
    """Pixels × samples of a picture."""
    draft_atlas: Count = 256
    draft_pixels: Count = 320 * 240

    def __init__(self, **given: object):
        for name in ("allowed_hosts", "cors_origins"):
            value = given.get(name, os.environ.get(f"TEXSSS_{name.upper()}"))
            if isinstance(value, str):
                given[name] = tuple(re.split(r"[\s,]+", value.strip().lower()))
        if not given.get("assets_dir", os.environ.get("TEXSSS_ASSETS_DIR")):
            given["assets_dir"] = None  # an empty name is none, not the current folder
        super().__init__(**given)  # pyright: ignore[reportArgumentType]

    @field_validator("allowed_hosts")
    @classmethod
    def _named(cls, hosts: tuple[str, ...]) -> tuple[str, ...]:
        for host in hosts:
            if not re.fullmatch(r"\*|[\w.-]+|[0-9a-fA-F:]+", host):
                raise ValueError(f"expected names of hosts such as bake.example, or *, got {host!r}")
        return tuple(host.lower() for host in hosts)

    @field_validator("cors_origins")
    @classmethod
    def _origins(cls, origins: tuple[str, ...]) -> tuple[str, ...]:
        for origin in filter(None, origins):
            if not re.fullmatch(r"\*|https?://[^/\s]+", origin):
                raise ValueError(f"expected origins such as https://studio.example, got {origin!r}")
        return tuple(filter(None, origins))


def of_options(**given: object) -> Settings:
    """The settings of the environment, overruled by options that are not None.

    Raises DomainError: when one is out of range.
    """
    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = ".".join(str(part) for part in first["loc"])
        said = first["msg"].removeprefix("Value error, ")
        raise DomainError(f"Settings: {name}: {said[0].lower()}{said[1:]}; see docs/service.md.") from None


def unknown() -> list[str]:
    """Variables that look like settings, and are none."""
    known = {f"TEXSSS_{name.upper()}" for name in Settings.model_fields} | OTHERS
    return sorted(name for name in os.environ if name.startswith("TEXSSS_") and name not in known)

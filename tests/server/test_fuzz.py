"""Bodies and parameters that nobody thought of: never a 500, always as the API describes itself."""

import json
import os

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from schemathesis.checks import CHECKS
from schemathesis.specs.openapi.checks import positive_data_acceptance
from serving import problem

CASES = int(os.environ.get("TEXSSS_FUZZ_CASES", "0"))
"""Cases per operation; the whole run of the figures sets 300."""

QUIET = {"deadline": None, "suppress_health_check": list(HealthCheck), "database": None}
NAMES = (
    *("mesh", "source", "path", "asset", "builtin", "unit_mm", "atlas", "size", "maps", "media", "material"),
    *("layers", "medium", "thickness_mm", "surface", "albedo", "lights", "type", "camera", "resolution"),
    *("methods", "terms", "output", "seed", "version", "direction", "position_mm", "range", "mix", "mask"),
)
WORDS = ("point", "skin1", "marble", "axolotl/axolotl.obj", "studio", "uv", "none", "0" * 64, "environment")
leaves = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.sampled_from([1e308, -1e308, 1e-320, 2**63, -(2**70), 0, -0.0, 16, 64])
    | st.text(max_size=8)
    | st.sampled_from(WORDS)
)
scenes = st.recursive(
    leaves,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(NAMES) | st.text(max_size=4), inner, max_size=5)
    ),
    max_leaves=12,
)
TINY = {"atlas": {"size": 16}, "camera": {"resolution": [8, 8], "samples": 1}}


def test_fuzzed_scenes_never_break_it(client):
    """No 500, whatever the JSON; 1,000 with TEXSSS_FUZZ_CASES=1000."""

    @settings(max_examples=max(150, CASES), derandomize=True, **QUIET)
    @given(st.dictionaries(st.sampled_from(NAMES), scenes, max_size=4))
    def check(body):
        text = json.dumps(TINY | body)
        answer = client.post("/v1/profile", content=text, headers={"content-type": "application/json"})
        assert answer.status_code in (200, 400, 422), (text, answer.text)
        if answer.status_code != 200:
            problem(answer, answer.status_code, answer.json()["type"].removeprefix("/problems/"))

    check()


@st.composite
def sensible(draw) -> dict:
    """Scenes that are nearly right: every part valid on its own, at the ends of its range."""
    number = st.floats(-1e6, 1e6) | st.sampled_from([0.0, 1e-30, 1e30])
    colour = st.lists(st.floats(0, 1e6) | st.sampled_from([0.0, 1e-12, 1e30]), min_size=3, max_size=3)
    vector = st.lists(number, min_size=3, max_size=3)
    lights = st.lists(
        st.fixed_dictionaries({"type": st.just("point"), "position_mm": vector, "intensity_w_per_sr": colour})
        | st.fixed_dictionaries({"type": st.just("directional"), "direction": vector})
        | st.just({"type": "studio"}),
        max_size=3,
    )
    medium = st.fixed_dictionaries(
        {
            "sigma_a_per_mm": colour,
            "sigma_s_per_mm": colour,
            "g": st.floats(-1.5, 1.5),
            "eta": st.floats(1, 3),
        }
    )
    layer = st.fixed_dictionaries(
        {"medium": st.sampled_from(["m", "skin1", "cream"])},
        optional={"thickness_mm": st.floats(0, 1e9)},
    )
    return {
        "media": {"m": draw(medium)},
        "material": {"layers": draw(st.lists(layer, min_size=1, max_size=4))},
        "lights": draw(lights),
        "camera": TINY["camera"] | {"direction": draw(vector), "fov_y_deg": draw(st.floats(1, 150))},
        "methods": {"profile": draw(st.sampled_from(["dipole", "multipole", "layered-sp3"]))},
        "output": {"exposure_ev": draw(st.floats(-30, 30))},
        "atlas": TINY["atlas"],
    }


def test_nearly_right_scenes_render_or_say_why(client, small):
    @settings(max_examples=max(40, CASES // 2), derandomize=True, **QUIET)
    @given(sensible())
    def check(body):
        answer = client.post("/v1/render", json=body | {"mesh": small["mesh"]})
        assert answer.status_code in (200, 422), (body, answer.text)

    check()


@pytest.fixture(scope="module")
def operations(server):
    """Every operation that the API describes, with its schema."""
    schema = schemathesis.openapi.from_url(f"{server.url}/openapi.json")
    return [found.ok() for found in schema.get_all_operations()]


def test_the_api_is_as_it_describes_itself(server, operations):
    """schemathesis: statuses, types, headers and bodies as documented; wrong data refused; never a 5xx.

    Not asked: that all data which fits the schema is accepted, since names and assets in it may not exist.
    """
    checks = [check for check in CHECKS.get_all() if check is not positive_data_acceptance]
    count = 0
    for operation in operations:
        if operation.path.endswith("/events"):
            continue  # streams are tried in test_jobs.py
        modes = schemathesis.GenerationMode

        @settings(max_examples=max(8, CASES), derandomize=True, phases=[Phase.generate], **QUIET)
        @given(
            operation.as_strategy(generation_mode=modes.POSITIVE)
            | operation.as_strategy(generation_mode=modes.NEGATIVE)
        )
        def check(case):
            nonlocal count
            shrink(case)
            count += 1
            case.call_and_validate(base_url=server.url, checks=checks, timeout=60)

        check()
    print(f"{count} cases")
    assert count >= 80


def shrink(case) -> None:
    """Keeps pictures small: what is tested is the door, not the kitchen."""
    if isinstance(case.body, dict) and isinstance(case.body.get("atlas"), dict):
        size = case.body["atlas"].get("size")
        if isinstance(size, int) and not isinstance(size, bool) and 64 < size <= 8192:
            case.body["atlas"]["size"] = 64
    if isinstance(case.body, dict):
        case.body.setdefault("atlas", {"size": 64})
        case.body.setdefault("camera", {"resolution": [16, 16], "samples": 1})

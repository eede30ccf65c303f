"""Which of the formats on offer a client wants, and how it prefers to be answered."""

from collections.abc import Iterable

from starlette.requests import Request
from texsss_server.problems import Problem


def accepted(request: Request, available: Iterable[str]) -> str:
    """The media type to answer with: the client's favourite, the first on offer among equals.

    Raises Problem: 406 when none is accepted. Source: RFC 9110, section 12.5.1.
    """
    offers = list(available)
    header = ",".join(request.headers.getlist("accept")).strip()
    if not header:
        return offers[0]
    ranges = [_range(part) for part in header.split(",") if part.strip()]
    best = max(offers, key=lambda offer: _quality(offer, ranges))
    if _quality(best, ranges) <= 0:
        raise Problem(
            "not-acceptable", f"Expected Accept to allow one of {', '.join(offers)}.", available=offers
        )
    return best


def preferences(request: Request) -> dict[str, str]:
    """What Prefer asks for, by name in lower case; the first of a name counts (RFC 7240, section 2)."""
    found: dict[str, str] = {}
    for one in ",".join(request.headers.getlist("prefer")).split(","):
        name, _, value = one.partition(";")[0].partition("=")
        found.setdefault(name.strip().lower(), value.strip().strip('"'))
    return found


def _range(part: str) -> tuple[str, float]:
    name, *parameters = (piece.strip().lower() for piece in part.split(";"))
    quality = 1.0
    for parameter in parameters:
        key, _, value = parameter.partition("=")
        if key.strip() == "q":
            try:
                quality = min(max(0.0, float(value)), 1.0)  # the first counts beside NaN
            except ValueError:
                quality = 0.0
    return name, quality


def _quality(offer: str, ranges: list[tuple[str, float]]) -> float:
    """Of the most specific range that covers the offer; 0 when none does."""
    for pattern in (offer, f"{offer.partition('/')[0]}/*", "*/*"):
        found = [quality for name, quality in ranges if name == pattern]
        if found:
            return max(found)
    return 0.0

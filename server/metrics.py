"""Prometheus metrics of one service."""

from typing import TYPE_CHECKING

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

if TYPE_CHECKING:
    from texsss_server.service import Service

BUCKETS = (0.002, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60)
METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")


class Metrics:
    """Counters of requests by route template, times of stages, and what is held now."""

    def __init__(self, service: "Service"):
        self.registry = registry = CollectorRegistry()
        labels = ["method", "route", "status"]
        self._requests = Counter("texsss_http_requests", "Requests answered.", labels, registry=registry)
        self._seconds = Histogram(
            "texsss_http_request_seconds", "Time to answer.", ["route"], buckets=BUCKETS, registry=registry
        )
        self._stages = Histogram(
            "texsss_stage_seconds", "Time of a stage that ran.", ["stage"], buckets=BUCKETS, registry=registry
        )
        self.hits = Counter("texsss_answers_kept", "Answers given from memory.", registry=registry)
        held = {
            "texsss_waiting": ("Requests that wait for the render thread.", lambda: service.worker.waiting),
            "texsss_running": ("Calls under way in the render thread.", lambda: service.worker.running),
            "texsss_cache_bytes": (
                "Results of stages kept.",
                lambda: service.worker.engine.cache_bytes if service.worker.engine else 0,
            ),
            "texsss_answer_bytes": ("Encoded answers kept.", lambda: service.answers.bytes_used),
            "texsss_asset_bytes": ("Uploads kept.", lambda: service.store.bytes_used),
            "texsss_jobs_unfinished": (
                "Jobs that wait or run.",
                lambda: sum(not job.finished for job in service.jobs),
            ),
        }
        for name, (text, value) in held.items():
            Gauge(name, text, registry=registry).set_function(value)

    def request(self, method: str, route: str, status: int, seconds: float) -> None:
        """Counts an answered request."""
        self._requests.labels(method if method in METHODS else "other", route, status).inc()
        self._seconds.labels(route).observe(seconds)

    def refused(self, status: int) -> None:
        """Counts what was answered before it was a request."""
        self._requests.labels("other", "unreadable", status).inc()

    def stages(self, seconds: dict[str, float]) -> None:
        """Notes what the stages of a computation took."""
        for stage, value in list(seconds.items()):
            self._stages.labels(stage).observe(value)

    def text(self) -> bytes:
        """All of it in Prometheus' text format."""
        return generate_latest(self.registry)

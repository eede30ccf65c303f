"""How the process starts: where it listens, what it says for people."""

import logging
import socket

import pytest
from texsss_server.assets import Store
from texsss_server.logs import TextFormatter
from texsss_server.serve import listening
from texsss_server.settings import Settings

from texsss.errors import AssetError, DomainError


def test_a_port_that_is_taken_is_told_before_anything_is_loaded():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(DomainError, match="--port"):
            listening("127.0.0.1", other.getsockname()[1])
    with pytest.raises(DomainError, match="--host"):
        listening("256.0.0.1", 8000)


def test_a_folder_for_uploads_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(AssetError, match="TEXSSS_ASSETS_DIR"):
        Store(Settings(assets_dir=tmp_path / "file" / "assets"))


def test_text_for_people_has_every_field():
    record = logging.LogRecord("texsss.server", logging.INFO, "", 0, "request", (), None)
    record.route, record.ms = "/v1/render", 1.5
    line = TextFormatter().format(record)
    assert "texsss.server request route=/v1/render ms=1.5 request=-" in line

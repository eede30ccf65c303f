"""How the process starts: where it listens, what it says for people."""

import logging
import socket

import pytest
from texsss_server.assets import ARRIVING, Store
from texsss_server.logs import TextFormatter
from texsss_server.serve import listening
from texsss_server.settings import Settings, of_options, unknown

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


def test_files_of_others_stay(tmp_path):
    strange, ours = tmp_path / "upload-2026.png", tmp_path / f"{ARRIVING}x"
    for path in (strange, ours):
        path.touch()
    store = Store(Settings(assets_dir=tmp_path))
    assert strange.is_file() and not ours.exists()
    store.folder.joinpath("upload-2026.png").unlink()
    tmp_path.rmdir()
    assert store.bytes_used == 0  # somebody took the folder away
    store.close()


@pytest.mark.parametrize(
    "name, value, wrong",
    [
        ("ALLOWED_HOSTS", "http://a/", "bake.example"),
        ("ALLOWED_HOSTS", "", "bake.example"),
        ("CORS_ORIGINS", "foo", "https://"),
        ("GRACE_S", "inf", "grace_s"),
    ],
)
def test_settings_that_cannot_serve_are_told(monkeypatch, name, value, wrong):
    monkeypatch.setenv(f"TEXSSS_{name}", value)
    with pytest.raises(DomainError, match=wrong):
        of_options()


def test_settings_are_read_as_meant(monkeypatch):
    monkeypatch.setenv("TEXSSS_ALLOWED_HOSTS", "Localhost, bake.example")
    monkeypatch.setenv("TEXSSS_ASSETS_DIR", "")
    monkeypatch.setenv("TEXSSS_CONECTIONS", "5")
    settings = of_options()
    assert settings.allowed_hosts == ("localhost", "bake.example") and settings.assets_dir is None
    assert unknown() == ["TEXSSS_CONECTIONS"]


def test_text_for_people_has_every_field():
    record = logging.LogRecord("texsss.server", logging.INFO, "", 0, "request", (), None)
    record.route, record.ms = "/v1/render", 1.5
    line = TextFormatter().format(record)
    assert "texsss.server request route=/v1/render ms=1.5 request=-" in line

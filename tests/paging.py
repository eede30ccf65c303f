"""The page as its tests see it: addresses, pixels, what it says of itself."""

import base64
import json
import socket
import threading
import time
from contextlib import suppress
from urllib.parse import quote

import numpy as np

SETTLED = "#badge[data-state=final]"


METHODS = {
    **{"profile": "layered-sp3", "diffusion": "uv", "rule": "exit", "terms": 8, "incidence": "diffuse"},
    **{"single_scattering": "none", "march_samples": 4},
}
"""All of them, the quick one for diffusion: a scene with a mesh of its own starts from the page's."""


SMALL = {"viewport": {"width": 760, "height": 400}}
"""A window of few pixels, for pictures that the service makes of a view."""


def address(scene: dict) -> str:
    """The page with a scene as text in its address."""
    return "/#scene=" + quote(json.dumps(scene))


def pixels(page, quickly: bool = False) -> np.ndarray:
    """(H, W, 3) of the canvas as drawn now, read back in the task that drew it."""
    found = page.evaluate(
        """(quickly) => {
          const { width, height, data } = window.texsss.viewer.pixels(quickly);
          let text = '';
          for (let i = 0; i < data.length; i += 32768)
            text += String.fromCharCode(...data.subarray(i, i + 32768));
          return { width, height, data: btoa(text) };
        }""",
        quickly,
    )
    flat = np.frombuffer(base64.b64decode(found["data"]), np.uint8)
    return flat.reshape(found["height"], found["width"], 4)[::-1, :, :3].astype(np.int32)


def settle(page, act) -> None:
    """Does `act` and waits until the light it asks for is on the object in full."""
    before = page.evaluate("window.texsss.live.settles")
    act()
    deadline = time.monotonic() + 30
    while page.evaluate("window.texsss.live.settles") == before:
        page.wait_for_timeout(20)
        assert time.monotonic() < deadline, "nothing new was shown within 30 s"


def until(page, expression: str) -> None:
    """Waits until an expression is true; the page's policy forbids the browser's own way of waiting."""
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        if page.evaluate(expression):
            return
        page.wait_for_timeout(20)
    raise AssertionError(f"not true within 30 s: {expression}")


def pose(page) -> dict:
    """Where the camera stands."""
    return page.evaluate("window.texsss.viewer.orbit.pose")


def state(page) -> dict:
    """What is undone, shared and saved."""
    return page.evaluate("window.texsss.store.state")


def drop(page, path) -> None:
    """Drops a file on the picture, as a file manager would."""
    data = base64.b64encode(path.read_bytes()).decode()
    page.evaluate(
        """([name, data]) => {
          const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
          const transfer = new DataTransfer();
          transfer.items.add(new File([bytes], name));
          const view = document.querySelector('#view');
          const options = { dataTransfer: transfer, bubbles: true, cancelable: true };
          view.dispatchEvent(new DragEvent('drop', options));
        }""",
        [path.name, data],
    )


class Gate:
    """Passes bytes between an address of its own and a server's, while it is open."""

    def __init__(self, server):
        host, _, port = server.url.removeprefix("http://").partition(":")
        self.behind = (host, int(port))
        self.port = 0
        self.sockets: list[socket.socket] = []
        self.open()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def __enter__(self) -> "Gate":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def open(self) -> None:
        """Listens, at the same port as before."""
        listener = socket.create_server(("127.0.0.1", self.port))
        self.port = listener.getsockname()[1]
        self.sockets = [listener]
        threading.Thread(target=self._accept, args=(listener,), daemon=True).start()

    def close(self) -> None:
        """Ends all connections; new ones are refused."""
        for one in self.sockets:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self, listener: socket.socket) -> None:
        with suppress(OSError):
            while True:
                near, _ = listener.accept()
                far = socket.create_connection(self.behind)
                self.sockets += [near, far]
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=_pass, args=(source, sink), daemon=True).start()


def _pass(source: socket.socket, sink: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(65536):
            sink.sendall(data)
    for one in (source, sink):
        with suppress(OSError):
            one.shutdown(socket.SHUT_RDWR)

"""Packages without the page are refused: they would install, and show nothing."""

from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

PAGE = Path(__file__).parent / "server" / "static" / "index.html"


def require_page() -> None:
    """Raises SystemExit: when the page was not built."""
    if not PAGE.is_file():
        raise SystemExit("texsss: server/static is empty; run `make page` first, so that the package has it.")


class BuildPy(build_py):
    def run(self) -> None:
        if not self.editable_mode:
            require_page()
        super().run()


class Sdist(sdist):
    def run(self) -> None:
        require_page()
        super().run()


setup(cmdclass={"build_py": BuildPy, "sdist": Sdist})

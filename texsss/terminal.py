"""What the command line shows, how it ends, and checks of where it may write."""

import os
import re
import sys
import warnings
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from texsss.errors import AssetError, TexsssError

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130

OURS = "texsss: "  # how warnings of the project begin

console = Console(stderr=True)


def say(kind: str, colour: str, sentence: str) -> None:
    """A sentence to the user, word for word: file names may look like markup."""
    console.print(Text.assemble((kind, colour), " ", sentence), soft_wrap=True)


@contextmanager
def mistakes_told():
    """Ends the process where a user's mistake ends a command: one sentence, and exit code 2."""
    try:
        yield
    except typer.Abort:
        sys.exit(EXIT_INTERRUPTED)
    except TexsssError as error:
        said = str(error)
    except MemoryError:
        said = "Memory: this does not fit; take a smaller atlas (--size), or decimate the mesh."
    except typer.TyperException as error:  # an option or a command that is not understood
        said = " ".join(error.format_message().split()).rstrip(".?")
        said = re.sub(r"Input should be a valid (\w+), unable .*", r"expected it to be of the type \1", said)
        said = f"{said}; --help after the command lists what it takes."
    else:
        return
    say("error", "red", said)
    sys.exit(EXIT_BAD_INPUT)


@contextmanager
def noted_warnings():
    """Warnings of the project as notes, every one; those of others as ever."""
    with warnings.catch_warnings():
        others = warnings.showwarning

        def show(message, *rest, **where):
            sentence = str(message)
            if not sentence.startswith(OURS):
                return others(message, *rest, **where)
            sentence = sentence.removeprefix(OURS)
            say("note", "yellow", sentence[:1].upper() + sentence[1:])

        warnings.showwarning = show
        warnings.filterwarnings("always", message=OURS, category=RuntimeWarning)
        yield


def show_table(title: str, rows: dict) -> None:
    """Names and values on standard output."""
    table = Table(title=title, show_header=False, title_justify="left")
    for name, value in rows.items():
        table.add_row(name, shown(value))
    Console().print(table)


def shown(value: object) -> str:
    """A value in few digits."""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return "  ".join(f"{name} {shown(item)}" for name, item in value.items())
    if isinstance(value, list | tuple):
        return "  ".join(shown(item) for item in value)
    return str(value)


def image_name(path: Path, endings: tuple[str, ...] = (".png", ".exr"), option: str = "--out") -> None:
    """Raises AssetError: when `path` is not that of an image, or can't be written."""
    if path.suffix.lower() not in endings:
        known = " or ".join(endings)
        raise AssetError(f"Output: expected a name that ends in {known}, got {path}; change {option}.")
    writable(path.parent)


def writable(folder: Path) -> None:
    """Raises AssetError: when files can't be made in `folder`, before any work is done."""
    try:
        existing = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    except OSError as error:
        raise AssetError(
            f"Output: {folder} cannot be written ({error.strerror}); choose another with --out."
        ) from None
    if not existing.is_dir():
        raise AssetError(f"Output: expected a folder, got the file {existing}; choose another with --out.")
    if not os.access(existing, os.W_OK):
        raise AssetError(f"Output: {existing} cannot be written; choose another folder with --out.")


@contextmanager
def shown_progress():
    """A bar per stage on the terminal; silence where there is none."""
    with Progress(
        SpinnerColumn(),
        TextColumn("{task.description:<10}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=not console.is_terminal,
        disable=not console.is_terminal,
    ) as bars:
        tasks = {}

        def progress(stage: str, fraction: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=1.0)
            bars.update(tasks[stage], completed=fraction)

        try:
            yield progress
        except KeyboardInterrupt:
            console.print("stopped; nothing was written")
            raise typer.Exit(EXIT_INTERRUPTED) from None

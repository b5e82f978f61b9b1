"""Writing result files: whole or not at all, and never over something that this tool did not write."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from bgdsl.cli.console import RefusedError


def write(path: Path, text: str, *, ours: Callable[[str], bool], force: bool) -> None:
    """Put `text` at `path` by renaming a temporary file.

    An existing file is replaced where `ours` recognises its text, where it holds `text` already, or with `force`.
    RefusedError where that is not so, or where nothing can be written there.
    """
    if path.is_dir():
        raise RefusedError(f"{path} is a folder; name the file to write: {path / 'NAME'}")
    if path.exists() and not force and not ours(_start(path)) and not _holds(path, text):
        raise RefusedError(f"{path} exists and was not written by this command; --force replaces it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except (FileExistsError, NotADirectoryError) as error:
        raise RefusedError(f"{path} cannot be written: {error.filename} is a file, not a folder") from error
    except OSError as error:
        raise RefusedError(f"{path} cannot be written: {error.strerror}") from error
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
        os.chmod(name, 0o666 & ~_umask())
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _holds(path: Path, text: str) -> bool:
    """Whether the file is what would be written."""
    return path.is_file() and path.stat().st_size == len(text.encode()) and path.read_text("utf-8", errors="replace") == text


def _start(path: Path) -> str:
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            return file.read(65536)
    except OSError as error:
        raise RefusedError(f"{path} cannot be read: {error.strerror}") from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask

"""What takes long to make (machine code, splines), kept on disk by the digest of what it was made of.

A file is its content's SHA-256 and the content: whatever is cut short, damaged or unreadable counts as not there. Files are
written beside their place and renamed, so that concurrent runs see whole files only. The oldest go when the folder grows large.
"""

from __future__ import annotations

import os
import sys
import tempfile
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

LIMIT = 256 * 1024 * 1024
"""Bytes kept, about."""


def folder() -> Path:
    """`$BGDSL_CACHE`, or the user's folder for such things on this platform."""
    chosen = os.environ.get("BGDSL_CACHE")
    if chosen:
        return Path(chosen)
    home = Path.home()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", home / "AppData" / "Local")) / "bgdsl" / "cache"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "bgdsl"
    return Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache") / "bgdsl"


def recall(key: str) -> bytes | None:
    """What was kept under this key; None if there is nothing sound."""
    with suppress(OSError, RuntimeError):
        place = folder() / f"{key}.o"
        content = place.read_bytes()
        if len(content) > 32 and sha256(content[32:]).digest() == content[:32]:
            with suppress(OSError):
                os.utime(place)
            return content[32:]
    return None


def keep(key: str, content: bytes) -> None:
    """Keep it if the disk lets us; a cache that cannot be written is no error."""
    with suppress(OSError, RuntimeError):
        place = folder()
        place.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=place, suffix=".new")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(sha256(content).digest() + content)
            os.replace(name, place / f"{key}.o")
        except BaseException:
            with suppress(OSError):
                os.unlink(name)
            raise
        _trim(place)


def _trim(place: Path) -> None:
    """Delete the files longest unused until the rest is within the limit."""
    found = []
    for entry in os.scandir(place):
        with suppress(OSError):
            if entry.name.endswith((".o", ".new")):
                about = entry.stat()
                found.append((about.st_mtime, about.st_size, entry.path))
    total = sum(size for _, size, _ in found)
    for _, size, path in sorted(found):
        if total <= LIMIT:
            return
        with suppress(OSError):
            os.unlink(path)
        total -= size

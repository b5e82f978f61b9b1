"""The pages behind `bgc explain`: one Markdown file a code, its first line the title."""

from __future__ import annotations

from importlib.resources import files


def titles() -> dict[str, str]:
    """Every code that has a page, with its title."""
    pages = (page for page in files(__package__).iterdir() if page.name.endswith(".md"))
    return {page.name[:-3]: page.read_text("utf-8").partition("\n")[0].lstrip("# ") for page in sorted(pages, key=lambda page: page.name)}


def explanation(code: str) -> str | None:
    """The page of a code, or None if there is none."""
    page = files(__package__) / f"{code}.md"
    return page.read_text("utf-8") if code.isalnum() and page.is_file() else None

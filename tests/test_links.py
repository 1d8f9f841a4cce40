# SPDX-License-Identifier: Apache-2.0
"""Relative links in the documents point to files and headings that exist."""

import re
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
_FENCED = re.compile(r"^( *)(```|~~~).*?^\1\2", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"\[[^\]]*\]\(([^()\s]+)\)")
_PATH = re.compile(r"`((?:tests|docs|launch|config|examples|tactile_skin)/[\w./-]+\.\w+)`")


def text_of(page: Path) -> str:
    """The page without its code blocks."""
    return _FENCED.sub("", page.read_text(encoding="utf-8"))


def anchors(page: Path) -> set[str]:
    """What GitHub makes of the headings."""
    found: set[str] = set()
    used: Counter[str] = Counter()
    for title in re.findall(r"^#+ +(.+?) *$", text_of(page), re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title).lower()
        name = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
        found.add(f"{name}-{used[name]}" if used[name] else name)
        used[name] += 1
    return found


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_link_points_to_something(page):
    for link in _LINK.findall(text_of(page)):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f"{page.name}: {link}"
        if anchor:
            assert anchor in anchors(target), f"{page.name}: {link}"


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_path_that_is_named_exists(page):
    for path in _PATH.findall(text_of(page)):
        assert (ROOT / path).exists(), f"{page.name}: {path}"


def test_every_page_that_the_code_names_exists():
    """In messages and docstrings."""
    files = [*ROOT.glob("tactile_skin/**/*.py"), *ROOT.glob("tactile_skin/**/*.csv")]
    files += [
        *ROOT.glob("config/*.yaml"),
        *ROOT.glob("tests/**/*.py"),
        *ROOT.glob("examples/**/*.*"),
    ]
    for file in files:
        for page in re.findall(r"\bdocs/[\w/]+\.md\b", file.read_text(encoding="utf-8")):
            assert (ROOT / page).exists(), f"{named(file)}: {page}"

# SPDX-License-Identifier: Apache-2.0
"""What the site does beyond mkdocs: files of the repository that pages link to are part of it."""

import posixpath
import re
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[1]
CONTRIBUTING = "CONTRIBUTING.md"  # a page of the site, though it lies outside docs/
_LINK = re.compile(r"(?<=\]\()([^()\s#:]+)(#[^()\s]*)?(?=\))")


def on_files(files, config):
    """Add CONTRIBUTING.md, whose links start at the repository's root, as a page."""
    text = (ROOT / CONTRIBUTING).read_text(encoding="utf-8")
    text = _LINK.sub(lambda found: posixpath.relpath(found[1], "docs") + (found[2] or ""), text)
    files.append(File.generated(config, CONTRIBUTING.lower(), content=text))


def on_page_markdown(markdown, page, config, files):
    """Copy linked files from outside docs/ to the site as plain text, and link to the copies."""

    def linked(found: re.Match) -> str:
        folder = posixpath.dirname(page.file.src_uri)
        path = posixpath.normpath(posixpath.join("docs", folder, found[1]))
        if path == CONTRIBUTING:
            return posixpath.relpath(CONTRIBUTING.lower(), folder or ".") + (found[2] or "")
        if path.startswith("docs/") or not (ROOT / path).is_file():
            return found[0]
        # a suffix that every browser shows in place of saving the file
        name = posixpath.join("source", path + ("" if path.endswith(".txt") else ".txt"))
        if not files.get_file_from_path(name):
            text = (ROOT / path).read_text(encoding="utf-8")
            files.append(File.generated(config, name, content=text))
        return posixpath.relpath(name, folder or ".")

    return _LINK.sub(linked, markdown)

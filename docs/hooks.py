"""What the site does beyond mkdocs: a file of the repository that a page links to is part of it."""

import posixpath
import re
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[1]
_LINK = re.compile(r"(?<=\]\()([^()\s#:]+)(#[^()\s]*)?(?=\))")


def on_page_markdown(markdown, page, config, files):
    """Copy linked files from outside docs/ to the site as plain text, and link to the copies."""

    def linked(found: re.Match) -> str:
        folder = posixpath.dirname(page.file.src_uri)
        path = posixpath.normpath(posixpath.join("docs", folder, found[1]))
        if path.startswith("docs/") or not (ROOT / path).is_file():
            return found[0]
        # a suffix that every browser shows in place of saving the file
        name = posixpath.join("source", path + ("" if path.endswith(".txt") else ".txt"))
        if not files.get_file_from_path(name):
            text = (ROOT / path).read_text(encoding="utf-8")
            files.append(File.generated(config, name, content=text))
        return posixpath.relpath(name, folder or ".")

    return _LINK.sub(linked, markdown)

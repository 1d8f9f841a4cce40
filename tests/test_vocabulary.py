# SPDX-License-Identifier: Apache-2.0
"""Words that CONTRIBUTING.md lists are not used: in documents, docstrings and messages.

Files that still hold some have an allowance in vocabulary.csv. It only shrinks: after you rewrote
some, `python tests/test_vocabulary.py` writes it again.
"""

import ast
import csv
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ALLOWANCE = Path(__file__).with_name("vocabulary.csv")
# A number may be whole, and a word that is code, as Identified.told, is a name.
UNUSED = re.compile(
    r"\b(?:told|tells?|whole(?! numbers?\b)|beside|apart|anew|from which on)\b"
    r"|\bof the same(?=[.,;:)]|$)|, say\b",
    re.IGNORECASE | re.MULTILINE,
)
_CODE = re.compile(r"(`+).+?\1", re.DOTALL)
_LIST = re.compile(r"^## Words$.*?(?=^## |\Z)", re.DOTALL | re.MULTILINE)  # names the words
TEXTS = ["*.md", "*.rst", "docs/**/*.md", "config/*.yaml", "launch/*.yaml", "tactile_skin/**/*.csv"]
CODE = ["tactile_skin/**/*.py", "examples/*.py", "benchmarks/*.py"]


def prose(path: Path) -> list[str]:
    """A document's text without code; of a module its docstrings and messages."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        return [_CODE.sub("", _LIST.sub("", text) if path.name == "CONTRIBUTING.md" else text)]
    strings = (n.value for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Constant))
    # a string without a space is a name or a key
    return [_CODE.sub("", s) for s in strings if isinstance(s, str) and " " in s.strip()]


def count(path: Path) -> int:
    return sum(len(UNUSED.findall(text)) for text in prose(path))


def files() -> list[Path]:
    made = {ROOT / "docs" / name for name in ("api.md", "commands.md")}  # of the code
    return [p for pattern in TEXTS + CODE for p in sorted(ROOT.glob(pattern)) if p not in made]


def counts() -> dict[str, int]:
    return {str(p.relative_to(ROOT)): n for p in files() if (n := count(p))}


def allowance() -> dict[str, int]:
    with ALLOWANCE.open(encoding="utf-8", newline="") as file:
        return {row["file"]: int(row["words"]) for row in csv.DictReader(file)}


def test_no_file_uses_more_of_these_words_than_it_did():
    allowed = allowance()
    over = {f: (n, allowed.get(f, 0)) for f, n in counts().items() if n > allowed.get(f, 0)}
    assert not over, f"used, allowed: {over}; CONTRIBUTING.md has better words"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("What the frames tell", 1),
        ("must be a whole number", 0),
        ("two rows of whole numbers", 0),
        ("Of the mean of the same.", 1),
        ("loads of the same weight", 0),
        ("a bottle, say", 1),
        ("`found.told` and besides", 0),
    ],
)
def test_the_words_are_found(text, found, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    assert count(page) == found


if __name__ == "__main__":
    lines = [f"{file},{n}" for file, n in sorted(counts().items())]
    ALLOWANCE.write_text("\n".join(["file,words", *lines]) + "\n", encoding="utf-8")

"""Command lines of files and NAME:=VALUE."""

from __future__ import annotations


def split(words: list[str], kinds: dict[str, type]) -> tuple[list[str], dict]:
    """Files, and name -> value of the right type.

    Args:
        kinds: name -> its type: str, int or float.

    Raises:
        ValueError: an unknown name, one that is given twice, or a value of another type.
    """
    files, given = [], {}
    for word in words:
        name, mark, text = word.partition(":=")
        if not mark:
            files.append(word)
            continue
        if name not in kinds:
            raise ValueError(f"argument {name!r}: must be one of {', '.join(kinds)}")
        if name in given:
            raise ValueError(f"argument {name!r} is given twice")
        try:
            given[name] = kinds[name](text)
        except ValueError:
            what = "a whole number" if kinds[name] is int else "a number"
            raise ValueError(f"{name}:={text}: must be {what}") from None
    return files, given

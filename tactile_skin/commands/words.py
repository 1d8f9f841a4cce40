"""Command lines of files and NAME:=VALUE."""

from __future__ import annotations

_BOOLS = {"true": True, "false": False}


def split(words: list[str], kinds: dict[str, type]) -> tuple[list[str], dict]:
    """Files, and name -> value of the right type.

    Args:
        kinds: name -> its type: str, int, float or bool.

    Raises:
        ValueError: an unknown name, one that is given twice, or a value of another type.
    """
    files, given = [], {}
    for word in words:
        name, mark, text = word.partition(":=")
        if not mark:
            if word.partition("=")[0] in kinds:
                raise ValueError(f"{word!r}: arguments are written NAME:=VALUE")
            files.append(word)
            continue
        if name not in kinds:
            raise ValueError(f"argument {name!r}: must be one of {', '.join(kinds)}")
        if name in given:
            raise ValueError(f"argument {name!r} is given twice")
        try:
            given[name] = _BOOLS[text] if kinds[name] is bool else kinds[name](text)
        except (ValueError, KeyError):
            what = {int: "a whole number", bool: "true or false"}.get(kinds[name], "a number")
            raise ValueError(f"{name}:={text}: must be {what}") from None
    return files, given

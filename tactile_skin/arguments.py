# SPDX-License-Identifier: Apache-2.0
"""Command lines: `--name value`, `--name=value` and `name:=value` say the same in every command."""

from __future__ import annotations

import argparse
from collections import deque
from pathlib import Path

from .errors import is_unknown

_BOOLS = {"true": True, "false": False}


class CommandParser(argparse.ArgumentParser):
    """Parse the words of one command, each argument in either style, files anywhere among them.

    An argument that the parser does not declare becomes NAME:=VALUE in `words`, if the command has
    such: it is for a launch file, or for `split`.
    """

    def parse_known_args(self, args=None, namespace=None):
        return super().parse_known_args(self._in_one_style(args or []), namespace)

    def error(self, message: str):
        """End with one line, as all mistakes do."""
        self.exit(2, f"{self.prog}: error: {message}\n")

    def _in_one_style(self, args: list[str]) -> list[str]:
        """Return files, then NAME:=VALUE, then the options that argparse knows."""
        steps = [
            name for a in self._actions if a.nargs == argparse.PARSER for name in a.choices or ()
        ]
        if steps:  # the parser of a step knows all other words
            step = next((word for word in args if word in steps), None)
            return [step, *(word for word in args if word != step)] if step else list(args)
        options = {s.strip("-"): a for s, a in self._option_string_actions.items()}
        options = {name.replace("-", "_"): action for name, action in options.items()}
        takes_any = any(action.dest == "words" for action in self._actions)
        files, words, given, seen, rest = [], [], [], set(), deque(args)
        while rest:
            word = rest.popleft()
            name, mark, text = word.partition(":=")
            if not (mark or _is_option(word)):
                files.append(word)
                continue
            values: list[str] | None = [text]
            if mark:
                name = name.removeprefix("--")
            else:
                name, mark, text = word.lstrip("-").partition("=")
                name, values = name.replace("-", "_"), [text] if mark else None
            action = options.get(name)
            if action and name in seen:  # of the others `split` says it
                self.error(f"argument {name!r} is given twice")
            seen.add(name)
            if action is None and not takes_any:
                names = (key for key in options if len(key) > 1)
                self.error(f"argument {name!r} {is_unknown(name, names)}")
            nargs = action and action.nargs  # None: one value
            if values is None:
                most, values = {0: 0, "+": len(rest)}.get(nargs, 1), []
                while rest and len(values) < most and not (_is_option(rest[0]) or ":=" in rest[0]):
                    values.append(rest.popleft())
            elif nargs == 0:
                if values[0] not in _BOOLS:
                    self.error(f"argument {name}:={values[0]}: must be true or false")
                if not _BOOLS[values.pop()]:
                    continue
            elif nargs == "+":
                values = values[0].split(",")
            if action is None:
                words.append(f"{name}:={values[0] if values else 'true'}")
            elif values and nargs is None:
                given.append(f"{action.option_strings[-1]}={values[0]}")
            else:
                given += [action.option_strings[-1], *values]
        return files + words + given


def _is_option(word: str) -> bool:
    """Whether a word is -x or --name, and no negative number."""
    return len(word) > 1 and word[0] == "-" and not (word[1].isdecimal() or word[1] == ".")


def split(words: list[str], kinds: dict[str, type] | None = None) -> tuple[list[str], dict]:
    """Return files, and name -> value of the right type.

    Args:
        kinds: name -> its type: str, int, float or bool; None: any name, as text.

    Raises:
        ValueError: an unknown name, one that is given twice, or a value of another type.
    """
    files, given = [], {}
    for word in words:
        name, mark, text = word.partition(":=")
        if not mark:
            if "=" in word and (kinds is None or word.partition("=")[0] in kinds):
                raise ValueError(f"{word!r}: arguments are written name:=value, or --name value")
            files.append(word)
            continue
        if kinds is not None and name not in kinds:
            raise ValueError(f"argument {name!r} {is_unknown(name, kinds)}")
        kind = str if kinds is None else kinds[name]
        if name in given:
            raise ValueError(f"argument {name!r} is given twice")
        try:
            given[name] = _BOOLS[text] if kind is bool else kind(text)
        except (ValueError, KeyError):
            what = {int: "a whole number", bool: "true or false"}.get(kind, "a number")
            raise ValueError(f"{name}:={text}: must be {what}") from None
    return files, given


def check_folder(out: Path) -> None:
    """Refuse, with ValueError, an --out that cannot be a folder, before long work."""
    if out.exists() and not out.is_dir():
        raise ValueError(f"--out {out}: must be a folder")

"""What is said of a parameter besides its name, and how a dataclass of parameters is walked."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any, NamedTuple

_ABOUT, _GROUP = "about", "group"  # keys of a field's metadata


@dataclasses.dataclass(frozen=True)
class About:
    """Attributes:
    unit: of the value, or of each in a list; empty: it has none.
    text: what it is; what follows a semicolon says what special values mean.
    low, high: range of the value, or of each in a list; None: any.
    choices: the texts that it may be; empty: any.
    live: it may change while the node runs.
    any_type: values of other types than the default's are allowed.
    """

    unit: str
    text: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    live: bool = False
    any_type: bool = False

    @property
    def description(self) -> str:
        """All of it but the range, in one line: choices, text, unit, special values."""
        head, mark, rest = self.text.partition(";")
        unit = f"[{self.unit}]" if self.unit else ""
        choices = " or ".join(", ".join(self.choices).rsplit(", ", 1))
        said = ": ".join(filter(None, [choices, " ".join(filter(None, [head, unit]))]))
        return said + mark + rest


class Leaf(NamedTuple):
    """A parameter: its name within the dataclass that was walked, such as "circuit.rows"."""

    name: str
    default: Any
    about: About


def parameter(default, unit: str, text: str, low=None, high=None, **more) -> Any:
    """Return a dataclass field that is a parameter: see `About`."""
    about = About(unit, text, low, high, **more)
    if isinstance(default, list):
        return dataclasses.field(default_factory=lambda: list(default), metadata={_ABOUT: about})
    return dataclasses.field(default=default, metadata={_ABOUT: about})


def group(kind: type) -> Any:
    """Return a dataclass field that holds parameters under a common name."""
    return dataclasses.field(default_factory=kind, metadata={_GROUP: kind})


def members(kind: type) -> Iterator[tuple[str, type | Leaf]]:
    """Yield each name in a dataclass of parameters, with the group or the parameter it stands for.

    Raises:
        KeyError: a field that neither `parameter` nor `group` made.
    """
    for field in dataclasses.fields(kind):
        if _GROUP in field.metadata:
            yield field.name, field.metadata[_GROUP]
        else:
            default = field.default
            if default is dataclasses.MISSING:
                default = field.default_factory()  # type: ignore[misc]
            yield field.name, Leaf(field.name, default, field.metadata[_ABOUT])


def leaves(kind: type, prefix: str = "") -> Iterator[Leaf]:
    """Yield all parameters in a dataclass of parameters, those of its groups as "group.name"."""
    for name, member in members(kind):
        if isinstance(member, Leaf):
            yield member._replace(name=prefix + name)
        else:
            yield from leaves(member, f"{prefix}{name}.")


def configured(kind: type, values) -> Any:
    """Return the dataclass `kind` with those of its fields that `values` has as attributes."""
    names = [field.name for field in dataclasses.fields(kind) if hasattr(values, field.name)]
    return kind(**{name: getattr(values, name) for name in names})

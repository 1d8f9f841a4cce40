# SPDX-License-Identifier: Apache-2.0
"""What is said of a parameter besides its name, and how a dataclass of parameters is walked."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

_MEMBER = "member"  # key of a field's metadata: a Leaf, or the dataclass of a group


@dataclasses.dataclass(frozen=True)
class About:
    """What is known of a parameter."""

    unit: str  # of the value, or of each in a list; empty: it has none
    text: str  # what it is; what follows a semicolon says what special values mean
    # low, high: range of the value, or of each in a list; None: any
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()  # the texts that it may be; empty: any
    live: bool = False  # it may change while the node runs
    any_type: bool = False  # values of other types than the default's are allowed

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
    leaf = Leaf("", default, About(unit, text, low, high, **more))
    if isinstance(default, list):
        return dataclasses.field(default_factory=lambda: list(default), metadata={_MEMBER: leaf})
    return dataclasses.field(default=default, metadata={_MEMBER: leaf})


def group(kind: type) -> Any:
    """Return a dataclass field that holds parameters under a common name."""
    return dataclasses.field(default_factory=kind, metadata={_MEMBER: kind})


def members(kind: type) -> Iterator[tuple[str, type | Leaf]]:
    """Yield each name in a dataclass of parameters, with the group or the parameter it stands for.

    Raises:
        KeyError: a field that neither `parameter` nor `group` made.
    """
    for field in dataclasses.fields(kind):
        member = field.metadata[_MEMBER]
        yield field.name, member._replace(name=field.name) if isinstance(member, Leaf) else member


def leaves(kind: type, prefix: str = "") -> Iterator[Leaf]:
    """Yield all parameters in a dataclass of parameters, those of its groups as "group.name"."""
    for name, member in members(kind):
        if isinstance(member, Leaf):
            yield member._replace(name=prefix + name)
        else:
            yield from leaves(member, f"{prefix}{name}.")


class Checked:
    """A dataclass of parameters that takes no number below its range, and none that is not finite.

    What is above its range is for simulations: only a node refuses it.
    """

    def __post_init__(self) -> None:
        for name, member in members(type(self)):
            if isinstance(member, Leaf) and member.about.low is not None:
                low, value = member.about.low, getattr(self, name)
                if not low <= value < math.inf:
                    raise ValueError(f"{name} = {value!r}: must be finite, and at least {low}")

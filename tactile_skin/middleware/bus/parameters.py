# SPDX-License-Identifier: Apache-2.0
"""Parameters: declared with a default, checked against its type and what is said of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from ...errors import ParameterError
from ...fields import About

ANYTHING = About("", "", live=True)  # of a parameter of which nothing is said


@dataclass(frozen=True)
class Parameter:
    """Attributes: `source`, the file that gives the value; empty: none does."""

    name: str
    value: Any = None
    source: str = field(default="", compare=False)


@dataclass(frozen=True)
class SetParametersResult:
    """As rcl_interfaces/msg/SetParametersResult: what a node answers that is to change some."""

    successful: bool
    reason: str = ""


def checked(node: str, name: str, value, default, about: About):
    """Return the value in its default's type, or ParameterError with what is allowed."""
    where = f"parameter {name} of node {node}"
    if isinstance(default, float) and type(value) is int:
        value = float(value)
    if isinstance(default, list) and isinstance(value, list):
        if default and isinstance(default[0], float):
            value = [float(v) if type(v) is int else v for v in value]
        if default and any(type(v) is not type(default[0]) for v in value):
            kind = type(default[0]).__name__
            raise ParameterError(f"{where} = {value!r}: must be a list of {kind}", name)
    elif type(value) is not type(default) and not about.any_type:
        kind = type(default).__name__
        raise ParameterError(
            f"{where} = {value!r}: must be of type {kind}, as {default!r} is", name
        )
    for v in value if isinstance(value, list) else [value]:
        if isinstance(v, float) and not math.isfinite(v):
            raise ParameterError(f"{where} = {value!r}: must be finite", name)
        if about.low is not None and about.high is not None and not about.low <= v <= about.high:
            low, high = (type(v)(bound) for bound in (about.low, about.high))
            raise ParameterError(f"{where} = {v!r}: must be from {low} to {high}", name)
    if about.choices and value not in about.choices:
        allowed = ", ".join(about.choices)
        raise ParameterError(f"{where} = {value!r}: must be one of {allowed}", name)
    return value

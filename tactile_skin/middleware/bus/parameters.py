"""Parameters: declared with a default, checked against its type and range."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar

from ...errors import ParameterError


@dataclass(frozen=True)
class FloatingPointRange:
    from_value: float
    to_value: float


@dataclass(frozen=True)
class IntegerRange:
    from_value: int
    to_value: int


@dataclass(frozen=True)
class ParameterDescriptor:
    description: str = ""
    additional_constraints: str = ""
    read_only: bool = False
    dynamic_typing: bool = False
    floating_point_range: list[FloatingPointRange] = field(default_factory=list)
    integer_range: list[IntegerRange] = field(default_factory=list)


@dataclass(frozen=True)
class Parameter:
    name: str
    value: Any = None


class SetParameters:
    """The service by which a node is asked to change parameters, all of them or none."""

    TYPE: ClassVar[str] = "rcl_interfaces/srv/SetParametersAtomically"

    @dataclass
    class Request:
        parameters: list[Parameter] = field(default_factory=list)

    @dataclass
    class Response:  # rcl_interfaces/msg/SetParametersResult
        successful: bool = False
        reason: str = ""


SET_PARAMETERS = "~/set_parameters_atomically"


def checked(node: str, name: str, value, default, descriptor: ParameterDescriptor):
    """The value in its default's type, or ParameterError with what is allowed."""
    where = f"parameter {name} of node {node}"
    if isinstance(default, float) and type(value) is int:
        value = float(value)
    if isinstance(default, list) and isinstance(value, list):
        if default and isinstance(default[0], float):
            value = [float(v) if type(v) is int else v for v in value]
        if default and any(type(v) is not type(default[0]) for v in value):
            kind = type(default[0]).__name__
            raise ParameterError(f"{where} = {value!r}: must be a list of {kind}")
    elif type(value) is not type(default) and not descriptor.dynamic_typing:
        kind = type(default).__name__
        raise ParameterError(f"{where} = {value!r}: must be of type {kind}, as {default!r} is")
    numbers: list = value if isinstance(value, list) else [value]
    if any(isinstance(v, float) and not math.isfinite(v) for v in numbers):
        raise ParameterError(f"{where} = {value!r}: must be finite")
    ranges: list[Any] = [*descriptor.floating_point_range, *descriptor.integer_range]
    for bounds in ranges:
        for v in numbers:
            if not bounds.from_value <= v <= bounds.to_value:
                raise ParameterError(
                    f"{where} = {v!r}: must be from {bounds.from_value} to {bounds.to_value}"
                )
    return value

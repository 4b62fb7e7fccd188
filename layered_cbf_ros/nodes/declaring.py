"""Parameter dataclasses declared to ROS, with ranges and descriptions."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node

from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.parameters import described, from_mapping, parameters_of

P = TypeVar('P')


def declare(node: Node, cls: type[P]) -> P:
    """Declare every field of a parameter dataclass; return it with the node's values.

    Raises:
        ParameterError: If a value is of the wrong type or out of its range.
    """
    values = {}
    for name, field in parameters_of(cls).items():
        default = list(field.default) if isinstance(field.default, tuple) else field.default
        try:
            value = node.declare_parameter(name, default, _descriptor(field)).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise ParameterError(f'{cls.__name__}.{name}: {error}') from None
        values[name] = list(value) if isinstance(default, list) else value
    return from_mapping(cls, values)


def _descriptor(field: dataclasses.Field[Any]) -> ParameterDescriptor:
    meta = field.metadata
    descriptor = ParameterDescriptor(
        description=described(field),
        additional_constraints=', '.join(meta['choices']),
        read_only=True,
    )
    low, high = meta['minimum'], meta['maximum']
    if low is not None and high is not None:
        if isinstance(field.default, float):
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high))
            ]
        elif isinstance(field.default, int):
            descriptor.integer_range = [
                IntegerRange(from_value=int(low), to_value=int(high), step=1)
            ]
    return descriptor

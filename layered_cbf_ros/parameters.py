"""Node parameters: one frozen dataclass a node, its values in params/*.yaml.

A parameter carries its unit, its range and a description, so that the same line
of code validates a YAML file, declares the parameter to ROS and documents it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml

from layered_cbf_ros.errors import ParameterError

P = TypeVar('P')


def parameter(
    default: Any,
    description: str,
    unit: str = '',
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] = (),
    name: str = '',
) -> Any:
    """Return a dataclass field for a parameter.

    Args:
        default: Value if none is given: a bool, int, float, str, or a tuple of
            one of these, whose length is then fixed.
        description: What it is, for a person.
        unit: SI unit, or empty for a plain number.
        minimum, maximum: Closed range of a number, or of each entry of a tuple.
        choices: The values that a string may take, if not any.
        name: Its ROS name, where that is no Python name: `axis_linear.x`.
    """
    metadata = {
        'description': description,
        'unit': unit,
        'minimum': minimum,
        'maximum': maximum,
        'choices': choices,
        'name': name,
    }
    return dataclasses.field(default=default, metadata=metadata)


def parameters_of(cls: type) -> dict[str, dataclasses.Field[Any]]:
    """Return the fields of a parameter dataclass by their ROS names."""
    return {named(field): field for field in dataclasses.fields(cls)}


def named(field: dataclasses.Field[Any]) -> str:
    """Return the ROS name of a parameter."""
    return field.metadata.get('name') or field.name


def values_of(parameters: Any) -> dict[str, Any]:
    """Return the values of a parameter dataclass by their ROS names."""
    named = parameters_of(type(parameters))
    return {name: getattr(parameters, field.name) for name, field in named.items()}


def described(field: dataclasses.Field[Any]) -> str:
    """Return what a parameter is, with its unit, for a person."""
    unit = f' [{field.metadata["unit"]}]' if field.metadata['unit'] else ''
    return f'{field.metadata["description"]}{unit}'


def from_mapping(cls: type[P], values: Mapping[str, Any]) -> P:
    """Build a parameter dataclass, checking names, types and ranges.

    Raises:
        ParameterError: Naming the first field that is wrong, and the remedy.
    """
    fields = parameters_of(cls)
    for name in values:
        if name not in fields:
            known = ', '.join(sorted(fields))
            raise ParameterError(f"{cls.__name__}: unknown parameter '{name}'; known are {known}")
    return cls(
        **{fields[name].name: _checked(cls.__name__, fields[name], v) for name, v in values.items()}
    )


def from_file(cls: type[P], path: Path, node: str) -> P:
    """Build a parameter dataclass from a ROS parameter file.

    Args:
        cls: The dataclass.
        path: YAML file with `<node>: {ros__parameters: {...}}`.
        node: Node name to look for.

    Raises:
        ParameterError: If the file has no such node or a value is wrong.
    """
    content = read_parameter_file(path)
    if node not in content:
        raise ParameterError(f'{path.name}: no entry {node}: ros__parameters:')
    return from_mapping(cls, content[node])


def read_parameter_file(path: Path) -> dict[str, dict[str, Any]]:
    """Return what a ROS parameter file says, by node.

    Raises:
        ParameterError: If it can't be read or has another form.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
        return {str(node): _flat(entry['ros__parameters']) for node, entry in content.items()}
    except OSError as error:
        raise ParameterError(f'{path} cannot be read: {error.strerror}') from None
    except (yaml.YAMLError, AttributeError, KeyError, TypeError, ValueError):
        raise ParameterError(
            f'{path} is no parameter file; its form is '
            '`<node>: {ros__parameters: {<name>: <value>}}`'
        ) from None


def _flat(values: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Return nested names as ROS joins them: {axis_linear: {x: 1}} gives axis_linear.x."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        inner = _flat(value, f'{prefix}{name}.') if isinstance(value, Mapping) else None
        flat |= {f'{prefix}{name}': value} if inner is None else inner
    return flat


def _checked(owner: str, field: dataclasses.Field[Any], value: Any) -> Any:
    """Return the value in the field's own type, or raise ParameterError."""
    default = field.default
    if isinstance(default, tuple):
        if not isinstance(value, (list, tuple)) or len(value) != len(default):
            raise ParameterError(
                f'{owner}.{named(field)} is {value!r}; give a list of {len(default)} numbers'
            )
        entries = zip(default, value, strict=True)
        return tuple(_scalar(owner, field, like, entry) for like, entry in entries)
    return _scalar(owner, field, default, value)


def _scalar(owner: str, field: dataclasses.Field[Any], like: Any, value: Any) -> Any:
    """Check one entry against the type of its default and the field's range."""
    name = f'{owner}.{named(field)}'
    if isinstance(like, bool) or isinstance(value, bool):
        if type(like) is not type(value):
            raise ParameterError(f'{name} is {value!r}; give {_kind(like)}')
        return value
    if isinstance(like, float) and isinstance(value, int):
        value = float(value)
    if type(like) is not type(value):
        raise ParameterError(f'{name} is {value!r}; give {_kind(like)}')
    if isinstance(value, str):
        choices = field.metadata.get('choices', ())
        if choices and value not in choices:
            raise ParameterError(f'{name} is {value!r}; choose one of {", ".join(choices)}')
        return value
    _check_range(name, field, value)
    return value


def _check_range(name: str, field: dataclasses.Field[Any], value: float) -> None:
    minimum, maximum = field.metadata.get('minimum'), field.metadata.get('maximum')
    unit = field.metadata.get('unit', '')
    too_low = minimum is not None and value < minimum
    too_high = maximum is not None and value > maximum
    if not math.isfinite(value) or too_low or too_high:
        low = '-inf' if minimum is None else f'{minimum:g}'
        high = 'inf' if maximum is None else f'{maximum:g}'
        raise ParameterError(f'{name} is {value:g}; keep it in [{low}, {high}] {unit}'.rstrip())


def _kind(like: Any) -> str:
    names = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'a text'}
    return names[type(like)]

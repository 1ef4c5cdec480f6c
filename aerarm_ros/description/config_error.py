"""The error of every wrong configuration, and the checks that raise it."""

import math


class ConfigError(ValueError):
    """A configuration that can't be used; the message names the key and what it must be."""


def check_range(owner: str, key: str, value: float, low: float, high: float, unit: str) -> None:
    """Require `low <= value <= high`.

    The ranges are wide: they catch NaN and values in a wrong unit, not poor choices.

    Raises
    ------
    ConfigError
        If the value is outside, not finite, or not a number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f'{owner}: {key} must be a number, not {value!r}')
    if not (math.isfinite(value) and low <= value <= high):
        unit_text = f' [{unit}]' if unit else ''
        raise ConfigError(
            f'{owner}: {key} = {value} must lie in {low:g} .. {high:g}{unit_text}: '
            'check the number and its unit'
        )


def check_choice(owner: str, key: str, value: object, choices: tuple[object, ...]) -> None:
    """Require that `value` is one of `choices`.

    Raises
    ------
    ConfigError
        If it is another; the message lists the choices.
    """
    if isinstance(value, bool) or value not in choices:
        listed = ', '.join(str(choice) for choice in choices)
        raise ConfigError(f'{owner}: {key} = {value!r} must be one of {listed}')


def check_name(owner: str, key: str, value: object) -> None:
    """Require a text that isn't empty.

    Raises
    ------
    ConfigError
        If it is empty or no text.
    """
    if not isinstance(value, str) or not value.strip():
        raise ConfigError(f'{owner}: {key} = {value!r} must be a name')

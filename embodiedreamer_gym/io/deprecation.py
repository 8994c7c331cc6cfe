"""Old names that keep working for one release, with a DeprecationWarning."""

from __future__ import annotations

import functools
import importlib
import sys
import warnings
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

T = TypeVar("T")


def deprecated_names(module: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """A `__getattr__` for a module that resolves its old names.

    In the module: `__getattr__ = deprecated_names(__name__, {"old": "new"})`.
    module: its `__name__`.
    names: old name -> new name in the same module, or "package.module" (a module), or "package.module:name".
    """

    def get(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        new = names[name]
        place, colon, attribute = new.partition(":")
        warnings.warn(f"{module}.{name} is now {new.replace(':', '.')}", DeprecationWarning, stacklevel=2)
        if colon:
            return getattr(importlib.import_module(place), attribute)
        return importlib.import_module(place) if "." in place else getattr(sys.modules[module], place)

    return get


def present_name(what: str, name: str, names: Mapping[str, str]) -> str:
    """The current name of something; what: its kind, such as "effect"; names: former name -> current name."""
    if name in names:
        warnings.warn(f"{what} {name!r} is now {names[name]!r}", DeprecationWarning, stacklevel=3)
    return names.get(name, name)


def renamed_arguments(**names: str) -> Callable[[T], T]:
    """Decorate a function or class so that it also accepts keyword arguments by their old names: old="new"."""

    def decorate(target: Any) -> Any:
        function = target.__init__ if isinstance(target, type) else target

        @functools.wraps(function)
        def call(*args: Any, **given: Any) -> Any:
            for old in names.keys() & given.keys():
                text = f"argument {old!r} of {target.__qualname__} is now {names[old]!r}"
                warnings.warn(text, DeprecationWarning, stacklevel=2)
                given[names[old]] = given.pop(old)
            return function(*args, **given)

        if not isinstance(target, type):
            return call
        target.__init__ = call
        return target

    return decorate

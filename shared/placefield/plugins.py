"""Plugins: parts that other installed packages provide by entry points, see docs/extending.md.

They are searched and loaded only for a name that is not built in.
"""

from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal

from placefield.errors import ConfigError

Group = Literal["placefield.features", "placefield.sources", "placefield.recorders"]


def has_plugin(group: Group, name: str) -> bool:
    """Return whether an installed package provides a part of this name; it is not loaded."""
    return bool(_found(group, name))


def load_plugin(group: Group, name: str) -> Any:
    """Load the part of this name that an installed package provides.

    Raises:
        ConfigError: no package provides it, several do, or it cannot be loaded.
    """
    found, part = _found(group, name), f"{group.removeprefix('placefield.')[:-1]} {name!r}"
    if not found:
        raise ConfigError(f"{part}: no installed package brings it: install the one that does")
    if len(found) > 1:
        packages = ", ".join(sorted(map(_package, found)))
        raise ConfigError(f"{part}: several packages bring it: {packages}: remove all but one")
    try:
        return found[0].load()
    except Exception as error:  # whatever its modules do
        raise ConfigError(
            f"{part}: {_package(found[0])} brings it, and {found[0].value} cannot be loaded: "
            f"{type(error).__name__}: {error}"
        ) from None


def _found(group: Group, name: str) -> list[EntryPoint]:
    return list(
        {(_package(one), one.value): one for one in entry_points(group=group, name=name)}.values()
    )


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist else "a package"

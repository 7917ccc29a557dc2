"""What the routes are called in names of services and parameters."""

import re
from collections.abc import Iterable
from typing import Final

_LONGEST: Final = 80  # a whole name of ROS has at most 247 characters, and most of it is not ours


def ros_names(routes: Iterable[str]) -> dict[str, str]:
    """Give each route a name that ROS takes: its own where that is one.

    What ROS does not take becomes `_`, and a name that begins with a digit gets `route_` before
    it. Where that makes two names alike, the later ones in the file get `_2`, `_3` and so on.

    Args:
        routes: The names of all routes, in the order of the file.

    Returns:
        The names in ROS, by those of the routes.
    """
    names = list(routes)
    found = {name: name for name in names if _legal(name) == name}
    taken = set(found)
    for name in names:
        if name not in found:
            found[name] = _free(_legal(name), taken)
            taken.add(found[name])
    return {name: found[name] for name in names}


def _legal(name: str) -> str:
    legal = re.sub(r'[^A-Za-z0-9]+', '_', name)[:_LONGEST].rstrip('_') or 'route'
    return f'route_{legal}' if legal[0].isdigit() else legal


def _free(name: str, taken: set[str]) -> str:
    numbered = (f'{name}_{number}' for number in range(2, len(taken) + 3))
    return next(candidate for candidate in (name, *numbered) if candidate not in taken)

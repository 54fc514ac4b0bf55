"""Arrays as the compiled half takes them: contiguous, float32 and uint8, of shape (n, 3)."""

from __future__ import annotations

from typing import Any, Literal, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import Error

#: What ``checked`` returns.
Arrays = Tuple[NDArray[np.float32], Optional[NDArray[np.uint8]], Tuple[float, float, float]]
#: What callers may give for a cloud where several are expected.
CloudLike = Union[
    ArrayLike,
    Tuple[ArrayLike, Optional[ArrayLike]],
    Tuple[ArrayLike, Optional[ArrayLike], Sequence[float]],
]


#: Contiguous, and at an address that fits the type: parts of a message of ROS or of a file need not be.
_LAYOUT: Tuple[Literal["C"], Literal["A"]] = ("C", "A")


def _array(name: str, values: ArrayLike) -> NDArray[Any]:
    try:
        return np.asarray(values)
    except (TypeError, ValueError) as error:
        raise Error(f"{name}: must be an array, got {error}", "give one row for each point") from None


def checked(
    xyz: ArrayLike, rgb: Optional[ArrayLike] = None, viewpoint: Sequence[float] = (0.0, 0.0, 0.0)
) -> Arrays:
    """The cloud, or ``Error`` if the arrays are none. Copies only what is not yet of the right form."""
    points = _array("xyz", xyz)
    if points.ndim != 2 or points.shape[1] != 3:
        raise Error(f"xyz: must have the shape (n, 3), got {points.shape}", "give one row for each point")
    if points.dtype.kind not in "fiu":
        raise Error(f"xyz: must hold numbers, got {points.dtype}", "give float32 or float64, in metres")
    colours = None
    if rgb is not None:
        colours = _array("rgb", rgb)
        if colours.shape != points.shape:
            raise Error(
                f"rgb: must have the shape of xyz, {points.shape}, got {colours.shape}",
                "give one row for each point, or None",
            )
        if colours.dtype != np.uint8:
            raise Error(
                f"rgb: must hold uint8, got {colours.dtype}",
                "convert colours from 0 to 1 with (255 * rgb).round().astype(numpy.uint8)",
            )
        colours = np.require(colours, np.uint8, _LAYOUT)
    try:
        x, y, z = (float(value) for value in viewpoint)
    except (TypeError, ValueError):
        raise Error(f"viewpoint: must be three numbers, got {viewpoint!r}", "give (x, y, z)") from None
    with np.errstate(over="ignore"):
        return np.require(points, np.float32, _LAYOUT), colours, (x, y, z)


def checked_cloud(cloud: CloudLike) -> Arrays:
    """The same of ``xyz``, ``(xyz, rgb)`` or ``(xyz, rgb, viewpoint)``."""
    if not isinstance(cloud, (tuple, list)):
        return checked(cloud)
    if not 1 <= len(cloud) <= 3:
        raise Error(
            f"cloud: must be xyz, (xyz, rgb) or (xyz, rgb, viewpoint), got {len(cloud)} values",
            "put each cloud into a tuple of its own",
        )
    return checked(*cloud)

"""Clouds in files, as the programs read them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple, Optional, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from .errors import Error
from .native import read_cloud as _read_cloud

#: Bytes of the largest file that is read, as in the programs.
_MOST_BYTES = 256 << 20


class Cloud(NamedTuple):
    """A cloud in the order in which functions take one: ``recogniser.recognise(*cloud)``."""

    #: Of shape (n, 3), in the file's unit of length.
    xyz: NDArray[np.float32]
    #: Of the same shape; ``None`` where the file has no colours.
    rgb: Optional[NDArray[np.uint8]]
    #: Where the camera is.
    viewpoint: Tuple[float, float, float]


def read_cloud(path: Union[str, "os.PathLike[str]"]) -> Cloud:
    """The cloud in a PCD or PLY file. Points that are not finite are left out."""
    file = Path(path)
    try:
        if not file.is_file():
            # A pipe would be waited for.
            found = "something else" if file.exists() else "nothing of that name"
            raise Error(f"{file}: must be a file, got {found}", "name a PCD or PLY file")
        with file.open("rb") as stream:
            content = stream.read(_MOST_BYTES + 1)
    except OSError as error:
        raise Error(f"{file}: cannot be read, got {error}", "name a PCD or PLY file") from None
    if len(content) > _MOST_BYTES:
        raise Error(f"{file}: must have at most {_MOST_BYTES} bytes, got more", "cut out the object, or thin the cloud")
    return Cloud(*_read_cloud(content, file))

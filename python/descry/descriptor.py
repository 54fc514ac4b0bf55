"""Clouds described: one at a time, or as a transformer in a pipeline of scikit-learn."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, Iterable, List, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import CloudLike, checked, checked_cloud
from .errors import Error
from .native import NativeDescriber

PathOrText = Union[str, "os.PathLike[str]"]


if TYPE_CHECKING:
    _Floats = np.ndarray[Any, np.dtype[np.float32]]
else:
    # Older releases of numpy cannot say of what type an array is.
    _Floats = np.ndarray


class Signature(_Floats):
    """What a cloud is described by: float32 of shape (values,), channel after channel the centroid, then the deviation.

    ``channels`` has the two views of each channel; a deviation is empty in a channel of one row a cloud. Parts and
    reordered signatures have none.
    """

    lengths: Tuple[Tuple[int, int], ...]

    def __array_finalize__(self, source: Any) -> None:
        self.lengths = getattr(source, "lengths", ())

    def __getitem__(self, key: Any) -> Any:
        part = super().__getitem__(key)
        if isinstance(part, Signature):
            part.lengths = ()
        return part

    def __reduce__(self) -> Any:
        reduced: Any = super().__reduce__()
        function, arguments, state = reduced
        return function, arguments, (state, self.lengths)

    def __setstate__(self, state: Any) -> None:
        values, self.lengths = state
        super().__setstate__(values)

    @property
    def channels(self) -> List[Tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Centroid and deviation of each channel."""
        if not self.lengths or sum(map(sum, self.lengths)) != self.size:
            raise Error("channels: must be asked of a whole signature, got a part", "ask before slicing")
        channels, at, values = [], 0, self.view(np.ndarray)
        for centroid, deviation in self.lengths:
            middle, end = at + centroid, at + centroid + deviation
            channels.append((values[at:middle], values[middle:end]))
            at = end
        return channels


def _describer(descriptor: PathOrText) -> NativeDescriber:
    """An artefact's folder, a structure file, or the text of one."""
    text = os.fspath(descriptor)
    if "\n" in text:
        return NativeDescriber.structure(text, Path("descriptor"))
    path = Path(text)
    if path.is_dir():
        return NativeDescriber.artefact(path)
    try:
        size = path.stat().st_size
        if not path.is_file() or size > 1 << 20:
            raise Error(f"{path}: must be a structure file of at most 1 MiB, got {size} bytes", "name another")
        content = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise Error(
            f"{path}: cannot be read, got {error}", "name an artefact's folder or a structure file"
        ) from None
    return NativeDescriber.structure(content, path)


def describe(
    xyz: ArrayLike,
    rgb: Optional[ArrayLike],
    descriptor: PathOrText,
    viewpoint: Sequence[float] = (0.0, 0.0, 0.0),
) -> Signature:
    """The signature of a cloud, bit for bit that of the programs.

    ``xyz`` has the shape (n, 3), in metres (for an artefact of clouds in millimetres, in those); ``rgb`` is uint8 of the
    same shape, or ``None``; ``descriptor`` is an artefact's folder, a structure file, or the text of one; ``viewpoint``
    is where the camera is: normals are turned towards it. Points that are not finite are left out.
    """
    values, lengths = _describer(descriptor).describe(checked(xyz, rgb, viewpoint))
    signature = values.view(Signature)
    signature.lengths = tuple(lengths)
    return signature


class Descriptor:
    """A transformer for pipelines of scikit-learn: clouds in, an array of shape (clouds, values) out.

    A cloud is ``xyz``, ``(xyz, rgb)`` or ``(xyz, rgb, viewpoint)``. Nothing is fitted: ``fit`` opens the descriptor.
    """

    def __init__(self, descriptor: PathOrText = "") -> None:
        self.descriptor = descriptor

    def get_params(self, deep: bool = True) -> Dict[str, Any]:
        """The one setting."""
        return {"descriptor": self.descriptor}

    def set_params(self, **settings: Any) -> "Descriptor":
        """Changes the setting; ``fit`` takes it up."""
        for name, value in settings.items():
            if name != "descriptor":
                raise Error(f"set_params: must be descriptor, got {name}", "leave it out")
            self.descriptor = value
        return self

    def fit(self, clouds: Any = None, labels: Any = None, **_: Any) -> "Descriptor":
        """Opens the descriptor."""
        self.describer_ = _describer(self.descriptor)
        return self

    def transform(self, clouds: Iterable[CloudLike]) -> NDArray[np.float32]:
        """Signatures, one row a cloud, described in parallel; rows are equal to those of ``describe``."""
        describer = self.describer_ if hasattr(self, "describer_") else _describer(self.descriptor)
        rows = describer.describe_many([checked_cloud(cloud) for cloud in clouds])
        return np.stack(rows) if rows else np.empty((0, 0), np.float32)

    def fit_transform(self, clouds: Iterable[CloudLike], labels: Any = None, **_: Any) -> NDArray[np.float32]:
        """``fit``, then ``transform``."""
        return self.fit(clouds, labels).transform(clouds)

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "describer_")

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import InputTags, Tags, TargetTags, TransformerTags  # type: ignore

        tags = InputTags(two_d_array=False, allow_nan=True)
        return Tags(
            estimator_type="transformer",
            target_tags=TargetTags(required=False),
            transformer_tags=TransformerTags(),
            input_tags=tags,
        )

    def __getstate__(self) -> Dict[str, Any]:
        return {"descriptor": self.descriptor}

    def __repr__(self) -> str:
        return f"Descriptor(descriptor={self.descriptor!r})"

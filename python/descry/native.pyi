"""The compiled half; use the package instead."""

import os
from typing import List, Optional, Tuple, Union, final

import numpy as np
from numpy.typing import NDArray

from .errors import Error

__all__ = ["NativeDescriber", "NativeRecogniser", "read_cloud"]

_Path = Union[str, "os.PathLike[str]"]
_Arrays = Tuple[NDArray[np.float32], Optional[NDArray[np.uint8]], Tuple[float, float, float]]
_Answered = Tuple[List[Tuple[str, str, str, float]], bool, Optional[float]]

@final
class NativeDescriber:
    @staticmethod
    def artefact(folder: _Path) -> NativeDescriber: ...
    @staticmethod
    def structure(text: str, name: _Path) -> NativeDescriber: ...
    def describe(self, arrays: _Arrays) -> Tuple[NDArray[np.float32], List[Tuple[int, int]]]: ...
    def describe_many(self, arrays: List[_Arrays]) -> List[NDArray[np.float32]]: ...

@final
class NativeRecogniser:
    def __new__(cls, folder: _Path) -> NativeRecogniser: ...
    def recognise(self, arrays: _Arrays, most: int) -> _Answered: ...
    def recognise_many(
        self, arrays: List[_Arrays], most: int
    ) -> List[Tuple[Optional[_Answered], Optional[Error]]]: ...

def read_cloud(content: bytes, name: _Path) -> _Arrays: ...

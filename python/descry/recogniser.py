"""Objects named in clouds, by an artefact of ``coordinator export``."""

from __future__ import annotations

import operator
import os
from typing import Any, Iterable, List, Literal, NamedTuple, Optional, Sequence, Tuple, Union, overload

from numpy.typing import ArrayLike

from .arrays import CloudLike, checked, checked_cloud
from .errors import Error
from .native import NativeRecogniser


#: More than any artefact has objects.
_MOST = 1 << 30


class Named(NamedTuple):
    """An object by the reference cloud that is nearest, or most like the query."""

    instance: str
    category: str
    cloud: str
    #: Set distance to the reference cloud; of a recogniser that learns, 1 less the score of the object.
    distance: float


class Answer(NamedTuple):
    """What a cloud was recognised as."""

    instance: str
    category: str
    cloud: str
    distance: float
    #: How much farther the next object is; ``None`` where there is one object only.
    margin: Optional[float]
    #: Whether the object is one that the artefact does not show.
    unknown: bool
    #: How probably it is one of the artefact's; ``None`` of artefacts without a rule.
    known_probability: Optional[float]
    #: The nearest objects, nearest first.
    ranking: Tuple[Named, ...]


class Recogniser:
    """An artefact at work. May be used by several threads at once: the interpreter's lock is released."""

    def __init__(self, artefact: Union[str, "os.PathLike[str]"]) -> None:
        self.artefact = os.fspath(artefact)
        self._native = NativeRecogniser(self.artefact)

    def recognise(
        self,
        xyz: ArrayLike,
        rgb: Optional[ArrayLike] = None,
        viewpoint: Sequence[float] = (0.0, 0.0, 0.0),
        top: int = 2,
    ) -> Answer:
        """The object in a cloud; arrays as for ``describe``. ``top`` is how many objects are ranked, at least 1."""
        most = _checked_top(top)
        return _answer(self._native.recognise(checked(xyz, rgb, viewpoint), max(most, 2)), most)

    @overload
    def recognise_many(
        self, clouds: Iterable[CloudLike], top: int = 2, errors: Literal["raise"] = "raise"
    ) -> List[Answer]: ...

    @overload
    def recognise_many(
        self, clouds: Iterable[CloudLike], top: int, errors: Literal["return"]
    ) -> List[Union[Answer, Error]]: ...

    @overload
    def recognise_many(
        self, clouds: Iterable[CloudLike], top: int = 2, *, errors: Literal["return"]
    ) -> List[Union[Answer, Error]]: ...

    def recognise_many(
        self, clouds: Iterable[CloudLike], top: int = 2, errors: str = "raise"
    ) -> List[Any]:
        """The objects in clouds, each ``xyz``, ``(xyz, rgb)`` or ``(xyz, rgb, viewpoint)``, on all cores.

        A cloud without an answer raises ``Error``; with ``errors="return"`` the error stands in its place.
        """
        if errors not in ("raise", "return"):
            raise Error(f'errors: must be "raise" or "return", got {errors!r}', "choose one of them")
        most = _checked_top(top)
        arrays = [checked_cloud(cloud) for cloud in clouds]
        answers: List[Union[Answer, Error]] = []
        for answer, error in self._native.recognise_many(arrays, max(most, 2)):
            if error is not None and errors == "raise":
                raise error
            answers.append(_answer(answer, most) if error is None else error)
        return answers

    def __repr__(self) -> str:
        return f"Recogniser({self.artefact!r})"


def _checked_top(top: int) -> int:
    try:
        most = operator.index(top)
    except TypeError:
        most = 0
    if most < 1:
        raise Error(f"top: must be a whole number from 1, got {top!r}", "give how many objects to rank")
    return min(most, _MOST)


def _answer(native: Any, most: int) -> Answer:
    # The next object is there for the margin, whether or not it is asked for.
    named, unknown, known = native
    ranking = tuple(Named(*one) for one in named)
    first = ranking[0]
    margin = ranking[1].distance - first.distance if len(ranking) > 1 else None
    return Answer(*first, margin, unknown, known, ranking[:most])

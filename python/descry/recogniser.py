"""Objects named in clouds, by an artefact of ``coordinator export``."""

from __future__ import annotations

import os
from typing import Any, Iterable, List, Literal, NamedTuple, Optional, Sequence, Tuple, Union, overload

from numpy.typing import ArrayLike

from .arrays import CloudLike, checked, checked_cloud
from .errors import Error
from .native import NativeRecogniser


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
        """The object in a cloud; arrays as for ``describe``. ``top`` is how many objects are ranked."""
        return _answer(self._native.recognise(checked(xyz, rgb, viewpoint), max(int(top), 2)))

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
        arrays = [checked_cloud(cloud) for cloud in clouds]
        answers: List[Union[Answer, Error]] = []
        for answer, error in self._native.recognise_many(arrays, max(int(top), 2)):
            if error is not None and errors == "raise":
                raise error
            answers.append(_answer(answer) if error is None else error)
        return answers

    def __repr__(self) -> str:
        return f"Recogniser({self.artefact!r})"


def _answer(native: Any) -> Answer:
    named, unknown, known = native
    ranking = tuple(Named(*one) for one in named)
    first = ranking[0]
    margin = ranking[1].distance - first.distance if len(ranking) > 1 else None
    return Answer(*first, margin, unknown, known, ranking)

"""The one exception of this package."""


class Error(Exception):
    """What went wrong, in one line that ends in what was found, and what to do about it.

    ``what`` is the line, ``got`` its end (empty where nothing was found), ``advice`` the rest.
    """

    what: str
    got: str
    advice: str

    def __init__(self, what: str, advice: str = "") -> None:
        super().__init__(what, advice)
        self.what = what
        self.got = what.rpartition(", got ")[2] if ", got " in what else ""
        self.advice = advice

    def __str__(self) -> str:
        return f"{self.what}\n{self.advice}" if self.advice else self.what

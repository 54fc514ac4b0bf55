"""A run folder: its tables as polars frames, its winner, its figures."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Union

from .errors import Error

if TYPE_CHECKING:
    import polars


class Figure:
    """A figure of a report: a notebook shows it."""

    def __init__(self, name: str, svg: str) -> None:
        self.name = name
        self.svg = svg

    def _repr_svg_(self) -> str:
        return self.svg

    def save(self, path: Union[str, "os.PathLike[str]"]) -> None:
        """Writes the SVG."""
        Path(path).write_text(self.svg, encoding="utf-8")


class Run:
    """The folder of a run, finished or not. Tables are read when they are asked for."""

    def __init__(self, folder: Union[str, "os.PathLike[str]"]) -> None:
        self.folder = Path(folder)
        if not self.tables():
            raise Error(
                f"{self.folder}: must be a run folder, got no tables", "name a folder such as results/runs/demo"
            )

    def tables(self) -> List[str]:
        """Names of the tables that there are, in alphabetical order."""
        names = {path.parent.name for path in self.folder.glob("*/*.parquet") if path.name[0] != "."}
        return sorted(names)

    def table(self, name: str) -> polars.DataFrame:
        """A table as a polars frame: all its files, generations in order."""
        if name not in self.tables():
            known = ", ".join(self.tables())
            raise Error(f"{self.folder}: must have the table, got {name!r}", f"its tables: {known}")
        polars = _polars()
        files = sorted(path for path in (self.folder / name).glob("*.parquet") if path.name[0] != ".")
        # Files of another release may lack its newest columns.
        return polars.concat([polars.read_parquet(file) for file in files], how="diagonal")

    def query(self, sql: str) -> polars.DataFrame:
        """What polars' SQL answers about the tables, as a frame."""
        polars = _polars()
        context = polars.SQLContext({name: self.table(name).lazy() for name in self.tables()})
        return context.execute(sql, eager=True)

    @property
    def summary(self) -> Dict[str, Any]:
        """The row of table ``run``, which a finished run has."""
        if "run" not in self.tables():
            raise Error(
                f"{self.folder}: must be finished, got no table run", "start the run again to finish it"
            )
        return self.table("run").row(0, named=True)

    @property
    def winner(self) -> Dict[str, Any]:
        """The winner's row of table ``evaluations``: its genes, and what it recognised."""
        summary = self.summary
        polars = _polars()
        rows = self.table("evaluations").filter(
            (polars.col("generation") == summary["winner_generation"])
            & (polars.col("individual") == summary["winner_individual"])
        )
        return rows.row(0, named=True)

    def figure(self, name: str, program: Optional[str] = None) -> Figure:
        """A figure of ``coordinator report``, such as ``convergence``; ``program`` is where that is, if not on the path."""
        found = program or shutil.which("coordinator")
        if not found:
            raise Error(
                "coordinator: must be on the path to draw figures, got no such program",
                "build Descry and put target/release on the path, or give its place as program",
            )
        with tempfile.TemporaryDirectory() as folder:
            page, figures = Path(folder) / "report.html", Path(folder) / "figures"
            command = [found, "report", str(self.folder), "--out", str(page), "--svg", str(figures)]
            made = subprocess.run(command, capture_output=True, text=True, check=False)
            if made.returncode != 0:
                what, _, advice = made.stderr.strip().partition("\n")
                raise Error(f"coordinator report: must make the figures, got {what}", advice)
            files = {path.stem: path for path in figures.glob("*.svg")}
            if name not in files:
                known = ", ".join(sorted(files))
                raise Error(f"{self.folder}: must have the figure, got {name!r}", f"its figures: {known}")
            return Figure(name, files[name].read_text(encoding="utf-8"))

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r})"


def _polars() -> Any:
    try:
        import polars
    except ImportError:
        raise Error(
            "polars: must be installed to read tables, got no such package", "pip install polars"
        ) from None
    return polars

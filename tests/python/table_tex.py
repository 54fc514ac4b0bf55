"""Sets the table of a comparison (`coordinator report --figures`) in LaTeX, as a paper would.

Usage: table_tex.py TABLE.tex [NAME ...], where NAMEs are what must be read in the first column, from the top.

Needs pdflatex with cmap (Debian: texlive-latex-base, texlive-latex-recommended) and pdftotext (poppler-utils); the table
itself needs texlive-latex-base only. Each kind of document below must come out without
an error, a warning, or a letter that its fonts lack. Prints the table as it is read in the last one.
"""

import pathlib
import subprocess
import sys
import tempfile

# Without any package, as the manual says, and with the fonts that most papers have, so that letters can be read back.
PREAMBLES = ["", "\\usepackage{cmap}\n\\usepackage[T1]{fontenc}\n"]
DOCUMENT = "\\documentclass{{article}}\n{preamble}\\begin{{document}}\n\\noindent\\input{{{table}}}\n\\end{{document}}\n"
BAD = ("! ", "Missing character", "LaTeX Warning", "LaTeX Font Warning", "Runaway")


def set_in(folder, table, preamble):
    """Sets the table in a document; gives the lines that are read in it."""
    document = folder / "paper.tex"
    document.write_text(DOCUMENT.format(preamble=preamble, table=table.stem), encoding="utf-8")
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "-no-shell-escape", document.name]
    done = subprocess.run(command, cwd=folder, capture_output=True)
    log = (folder / "paper.log").read_text(encoding="utf-8", errors="replace")
    bad = [line for line in log.splitlines() if line.startswith(BAD)]
    if done.returncode != 0 or bad:
        sys.exit(f"table_tex: {table}: not set with preamble {preamble!r}:\n{log[-3000:]}")
    read = subprocess.run(["pdftotext", "-layout", "paper.pdf", "-"], cwd=folder, capture_output=True, check=True)
    return [line for line in read.stdout.decode().splitlines() if line.strip()]


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    given, names = pathlib.Path(sys.argv[1]), sys.argv[2:]
    for preamble in PREAMBLES:
        with tempfile.TemporaryDirectory() as folder:
            table = pathlib.Path(folder) / "table1.tex"
            table.write_bytes(given.read_bytes())
            lines = set_in(pathlib.Path(folder), table, preamble)
    # In the last kind: the first draws underscores as lines, which nobody reads. Below the head; the page has a number.
    rows = lines[1 : 1 + len(names)] if names else lines[1:-1]
    for name, row in zip(names, rows, strict=bool(names)):
        # Fonts of papers have no straight quotes.
        plain = row.replace("’", "'").replace("”", "''")
        if not plain.strip().startswith(f"{name} "):
            sys.exit(f"table_tex: {given}: must begin with {name!r}, got {row!r}")
    print("\n".join(lines))


if __name__ == "__main__":
    main()

"""The notebook of the Python package, run as a reader runs it.

A part of wheel.py that runs inside its environment.
"""

import json
import os
import shutil
import sys
from pathlib import Path

NOTEBOOK = Path(__file__).resolve().parents[2] / "python/examples/descry.ipynb"


def check(work):
    """``work`` stands for the repository: it has the folders of the demo."""
    import nbformat
    from nbclient import NotebookClient

    folder = work / "python/examples"
    folder.mkdir(parents=True)
    shutil.copy(NOTEBOOK, folder)
    # A kernel of this environment, whatever kernels the machine has.
    kernel = work / "jupyter/kernels/python3"
    kernel.mkdir(parents=True)
    command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    (kernel / "kernel.json").write_text(json.dumps({"argv": command, "display_name": "x", "language": "python"}))
    os.environ["JUPYTER_PATH"] = str(work / "jupyter")
    notebook = nbformat.read(folder / NOTEBOOK.name, as_version=4)
    nbformat.validate(notebook)
    # Raises where a cell does, and cells end in assertions.
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(folder)}}).execute()
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    silent = [cell.source for cell in cells if not cell.outputs]
    assert not silent, f"cells must show something, got nothing of {silent}"
    outputs = [output for cell in cells for output in cell.outputs]
    assert all(output.output_type == "execute_result" for output in outputs), outputs
    shown = {kind for output in outputs for kind in output.data}
    assert {"image/svg+xml", "text/html"} <= shown, f"a figure and frames are shown, got {shown}"
    print(f"the notebook runs: {len(cells)} cells")

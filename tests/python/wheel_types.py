"""The types of the Python package: mypy agrees with right uses, refuses wrong ones, and the stubs say what is there.

A part of wheel.py that runs inside its environment.
"""

import re
import subprocess
import sys
from pathlib import Path

PROGRAMS = Path(__file__).resolve().parent / "types"


def told(module, *options):
    """What mypy or its stubtest prints, and whether it agrees."""
    command = [sys.executable, "-m", module, *map(str, options)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode in (0, 1) and not done.stderr, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout, done.returncode == 0


def check(descry, cache):
    """``cache`` is a folder that is kept: with it, mypy does not read the packages' own stubs again."""
    right, wrong = PROGRAMS / "right.py", PROGRAMS / "wrong.py"
    unused = [name for name in descry.__all__ if f"descry.{name}" not in right.read_text()]
    assert not unused, f"{right.name} must use every public name, got none of {unused}"
    expected = {
        (number, code)
        for number, line in enumerate(wrong.read_text().splitlines(), 1)
        for code in re.findall("# refused: ([a-z-]+)$", line)
    }
    assert len(expected) > 15, expected
    output, _ = told("mypy", "--strict", "--no-pretty", "--no-error-summary", "--cache-dir", cache, right, wrong)
    errors = re.findall(r"^.*?(\w+)\.py:(\d+): error: .*\[([a-z-]+)\]$", output, re.M)
    assert {(name, int(line), code) for name, line, code in errors} == {("wrong", *one) for one in expected}, output
    output, agrees = told("mypy.stubtest", "--concise", "descry")
    assert agrees, output
    print(f"mypy refuses {len(expected)} wrong uses and no right one; stubs and module agree")

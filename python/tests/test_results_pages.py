"""Tables of pages of results are what the files beside them say."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_tables_of_the_closed_loop_page():
    program = ROOT / "examples/measurements/closed_loop_tables.py"
    ran = subprocess.run([sys.executable, program, "--check"], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr

"""The README's pieces of Python run as they stand, beside a run in `runs/half-cheetah-quick`."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import REPOSITORY

PIECES = re.findall(r"^```python\n(.*?)^```", (REPOSITORY / "README.md").read_text(), re.MULTILINE | re.DOTALL)


def test_the_readme_has_python() -> None:
    assert len(PIECES) == 3


@pytest.mark.parametrize("piece", PIECES, ids=[piece.split("\n")[0] for piece in PIECES])
def test_a_piece_runs(quick_run: Path, tmp_path: Path, piece: str) -> None:
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "half-cheetah-quick").symlink_to(quick_run)
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY / "examples" / "python")}
    command = [sys.executable, "-c", piece]
    ran = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr

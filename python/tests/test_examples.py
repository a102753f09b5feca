"""The configs in `examples/python/` run as they are but for their sizes."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from conftest import REPOSITORY

CONFIGS = sorted((REPOSITORY / "examples" / "python").glob("*.toml"))
SMALL = ["teacher.steps=2048", "teacher.d0_pool=5", "discover.candidates=5", "discover.contexts=6", "report.contexts=6"]
SMALL += ["discover.steps=5", "report.random_subsets=1"]


@pytest.mark.parametrize("config", CONFIGS, ids=lambda path: path.stem)
def test_an_example_runs(elo_program: Path, tmp_path: Path, config: Path) -> None:
    sizes = [argument for size in SMALL for argument in ("--set", size)]
    command = [elo_program, "discover", config, "--out", tmp_path / "run", *sizes]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert "maximum_mean: score" in ran.stdout


def test_there_are_examples() -> None:
    assert [path.stem for path in CONFIGS] == ["gusty_cart", "half_cheetah_bullet", "pendulum"]

"""The configs in `examples/python/` run as they are but for their sizes."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from conftest import REPOSITORY

CONFIGS = sorted((REPOSITORY / "examples" / "python").glob("*.toml"))
SMALL = ["discover.candidates=5", "discover.contexts=6", "report.contexts=6", "discover.steps=5", "report.random_subsets=1"]
TRAINED = ["teacher.steps=2048", "teacher.d0_pool=5"]


@pytest.mark.parametrize("config", [path for path in CONFIGS if path.stem != "ant_bullet"], ids=lambda path: path.stem)
def test_an_example_runs(elo_program: Path, tmp_path: Path, config: Path) -> None:
    trained = TRAINED if 'kind = "ppo"' in config.read_text() else []
    sizes = [argument for size in SMALL + trained for argument in ("--set", size)]
    command = [elo_program, "discover", config, "--out", tmp_path / "run", *sizes]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert "maximum_mean: score" in ran.stdout


def test_the_ant_on_bullet_is_a_config_without_faults(elo_program: Path) -> None:
    """It takes minutes to train an Ant that is better than random torque, which a run asks for."""
    config = REPOSITORY / "examples" / "python" / "ant_bullet.toml"
    checked = subprocess.run([elo_program, "config", "check", config], capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stderr


def test_there_are_examples() -> None:
    assert [path.stem for path in CONFIGS] == ["ant_bullet", "gusty_cart", "half_cheetah_bullet", "pendulum", "taught_cart"]

"""What the tests share: the program `elo`, runs of it, and environments that go wrong."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
ENVIRONMENTS = Path(__file__).resolve().parent / "environments"

CONFIG = """
seed = 1
[simulator]
kind = "python"
{simulator}
[initial_states]
max_random_steps = 5
[teacher]
kind = "ppo"
steps = 2048
d0_pool = 5
max_episode_steps = 50
[option_learner]
kind = "open_loop"
[discover]
teachers = 1
candidates = 4
contexts = 6
steps = 20
set_size = 2
[report]
contexts = 6
random_subsets = 1
[[metrics]]
kind = "maximum_mean"
[failures]
max_share = 1.0
[workers]
python = "{python}"
python_path = ["{environments}"]
{workers}
"""

Ran = subprocess.CompletedProcess[str]
Discover = Callable[..., Ran]


@pytest.fixture(scope="session")
def elo_program() -> Path:
    program = REPOSITORY / "target" / "release" / "elo"
    assert program.is_file(), "tests/set-up builds it"
    return program


@pytest.fixture(scope="session")
def quick_run(elo_program: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small run of `examples/half-cheetah-quick.toml`."""
    out = tmp_path_factory.mktemp("run")
    sizes = ["teacher.steps=4096", "discover.candidates=6", "discover.contexts=6", "discover.set_size=3"]
    sizes += ["discover.steps=8", "initial_states.max_random_steps=0", "report.contexts=6"]
    arguments = [argument for size in sizes for argument in ("--set", size)]
    config = REPOSITORY / "examples" / "half-cheetah-quick.toml"
    subprocess.run([elo_program, "discover", config, "--out", out, *arguments], check=True, capture_output=True)
    return out


@pytest.fixture(scope="session")
def closed_loop_run(elo_program: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small run of the half-cheetah with one set of closed-loop options, learned by practice."""
    out = tmp_path_factory.mktemp("closed-loop")
    sizes = ["option_learner.kind=interest", "option_learner.steps=240", "option_learner.rollout_steps=80"]
    sizes += ["option_learner.context_pool=5"]
    sizes += ["discover.candidates=1", "discover.contexts=6", "discover.set_size=3", "discover.steps=20"]
    sizes += ["initial_states.max_random_steps=0", "report.contexts=6"]
    arguments = [argument for size in sizes for argument in ("--set", size)]
    config = REPOSITORY / "examples" / "half-cheetah-quick.toml"
    subprocess.run([elo_program, "discover", config, "--out", out, *arguments], check=True, capture_output=True)
    return out


@pytest.fixture
def discover(elo_program: Path, tmp_path: Path) -> Discover:
    """Runs `elo discover` on a `[simulator]` table; its results are in `tmp_path / "run"`."""

    def run(simulator: str, *arguments: str, workers: str = "", out: str = "run", cwd: Path | None = None) -> Ran:
        text = CONFIG.format(
            simulator=simulator, python=sys.executable, environments=ENVIRONMENTS, workers=workers
        )
        (tmp_path / "run.toml").write_text(text)
        command = [elo_program, "discover", tmp_path / "run.toml", "--out", tmp_path / out, *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, cwd=cwd)

    return run

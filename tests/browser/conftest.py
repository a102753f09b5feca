"""A finished run, its page, and a browser that has no network."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
CHROMIUM = Path(os.environ.get("ELO_CHROMIUM", "/usr/bin/chromium"))
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
]  # fmt: skip


@pytest.fixture(scope="session")
def elo_program() -> Path:
    program = Path(os.environ.get("ELO_PROGRAM", REPOSITORY / "target" / "release" / "elo"))
    assert program.is_file(), "tests/set-up builds it"
    return program


@pytest.fixture(scope="session")
def run_folder(elo_program: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small run in Rapier with everything that a page can show. Rollouts go on after falls, so that films are long."""
    folder = tmp_path_factory.mktemp("runs") / "half-cheetah"
    small = {
        "teacher.steps": 16384, "teacher.snapshots": 3, "discover.teachers": 1, "discover.candidates": 12,
        "discover.contexts": 10, "discover.steps": 140, "discover.stop_at_fall": "false", "report.contexts": 12,
        "report.random_subsets": 2, "experiments.sweep": "[0.1, 1.0]",
    }  # fmt: skip
    changes = [f"--set={field}={value}" for field, value in small.items()]
    config = REPOSITORY / "examples" / "half-cheetah-quick.toml"
    run = [["discover", config, "--out", folder, *changes], ["experiments", folder]]
    for arguments in [*run, ["crosscheck", folder, "--simulator", "mujoco", "--contexts", "4"]]:
        subprocess.run([elo_program, *arguments], check=True, capture_output=True)
    return folder


@pytest.fixture(scope="session")
def bare_folder(run_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same run without experiments and without a comparison of engines."""
    folder = tmp_path_factory.mktemp("bare") / "bare"
    shutil.copytree(run_folder, folder)
    for name in ("experiments.json", "crosscheck.json"):
        (folder / "results" / name).unlink()
    return folder


@pytest.fixture(scope="session")
def page_file(elo_program: Path, run_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("page") / "report.html"
    command = [elo_program, "report", run_folder, "--out", out, "--simulator", "mujoco", "--replays", "2"]
    subprocess.run(command, check=True, capture_output=True)
    return out


@pytest.fixture(scope="session")
def files(run_folder: Path) -> dict[str, Any]:
    """The run's results by the name of their file."""
    names = ["report.json", "experiments.json", "crosscheck.json"]
    paths = [run_folder / "results" / name for name in names]
    return {path.name: json.loads(path.read_text()) for path in paths if path.exists()}


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="browser: the package playwright is not installed")
    if not CHROMIUM.exists():
        pytest.skip(f"browser: there is no {CHROMIUM} (ELO_CHROMIUM may name another)")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=FLAGS)
        yield browser
        browser.close()

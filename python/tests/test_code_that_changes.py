"""Code and files of users that are edited while a run is under way: no result may be stored under the key of what they were."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import ENVIRONMENTS, Discover

CHANGING = '''
from pathlib import Path

import elo.bodies
import toys


class Mass(toys.Mass):
    """Somebody edits the file `edited` at its first step."""

    def __init__(self, edited):
        super().__init__()
        self.edited = edited

    def step(self, action):
        edit(self.edited)
        return super().step(action)


class Body(elo.bodies.MujocoBody):
    """The same."""

    def __init__(self, robot, edited):
        super().__init__(robot)
        self.edited = edited

    def advance(self, torques):
        edit(self.edited)
        super().advance(torques)


def edit(path):
    with open(path, "ab+") as file:
        file.seek(0)
        if not file.read().endswith(b"# edited"):
            file.write(b"# edited")
'''

YIELDING = '''
import toys


def controller(task, seed):
    return toys.controller(task, seed)


def score(returns, mean, standard_deviation):
    return returns.mean(axis=1)
'''


@pytest.mark.parametrize(
    ("edited", "settings", "said"),
    [
        ("changing.py", [], "`changing:Mass` is not what it was when the config was read"),
        (
            "changing.py",
            ['simulator={kind="python_body",robot="half-cheetah",target="changing:Body",kwargs={edited="EDITED"}}'],
            "`changing:Body` is not what it was",
        ),
        ("yielding.py", ['teacher={kind="python",target="yielding:controller"}'], "`yielding:controller` is not what it was"),
        ("yielding.py", ['metrics=[{kind="python",target="yielding:score"}]'], "`yielding:score` is not what it was"),
        (
            "weights.npy",
            ['teacher={kind="python",target="toys:replayer",files={weights="weights.npy"}}'],
            "`toys:replayer` is not what it was",
        ),
    ],
)
def test_code_that_is_edited_during_a_run_ends_it(
    discover: Discover, tmp_path: Path, edited: str, settings: list[str], said: str
) -> None:
    (tmp_path / "changing.py").write_text(CHANGING)
    (tmp_path / "yielding.py").write_text(YIELDING)
    np.save(tmp_path / "weights.npy", np.zeros((1, 2), np.float32))
    path = tmp_path / edited
    if not settings or "simulator" not in settings[0]:
        settings = ['teacher={kind="python",target="toys:controller"}', *settings]
    arguments = [part for setting in settings for part in ("--set", setting.replace("EDITED", str(path)))]
    modules = f'workers.python_path=["{ENVIRONMENTS}","{tmp_path}"]'
    ran = discover(f'target = "changing:Mass"\nkwargs = {{ edited = "{path}" }}', "--set", modules, *arguments)
    assert ran.returncode != 0 and said in ran.stderr and "run again" in ran.stderr, ran.stderr
    assert path.read_bytes().endswith(b"# edited")
    assert not (tmp_path / "run" / "results" / "experiment.toml").exists()
    # As it is now, it serves.
    again = discover(f'target = "changing:Mass"\nkwargs = {{ edited = "{path}" }}', "--set", modules, *arguments)
    assert again.returncode == 0, again.stderr


@pytest.mark.parametrize(
    "simulator",
    [
        '{kind="python",target="habits:Geared",reward_floor=-10.0,files={gear="gear.txt"}}',
        '{kind="python_body",robot="half-cheetah",target="habits:Greased",files={gear="gear.txt"}}',
    ],
)
def test_files_of_an_environment_are_part_of_its_key_and_found_beside_the_config(
    discover: Discover, tmp_path: Path, simulator: str
) -> None:
    gear, results = tmp_path / "gear.txt", tmp_path / "run" / "results" / "select_terms.npy"
    folder = tmp_path / "elsewhere"
    folder.mkdir()

    def run() -> bytes:
        teacher = 'teacher={kind="python",target="toys:replayer",files={weights="weights.npy"}}'
        sizes = ["--set", "discover.steps=5", "--set", "initial_states.max_random_steps=0"]
        ran = discover(TARGET, "--set", f"simulator={simulator}", "--set", teacher, *sizes, cwd=folder)
        assert ran.returncode == 0, ran.stderr
        return results.read_bytes()

    shape = (6, 26) if "body" in simulator else (1, 2)
    np.save(tmp_path / "weights.npy", np.full(shape, 0.1, np.float32))
    gear.write_text("1.0")
    first = run()
    gear.write_text("0.5")
    assert run() != first
    gear.write_text("1.0")
    assert run() == first


@pytest.mark.parametrize("kind", ["python", "python_body"])
def test_files_that_are_not_there_or_are_given_twice_are_refused(discover: Discover, kind: str) -> None:
    table = f'simulator={{kind="{kind}",target="habits:Geared",files={{gear="gone.txt"}}'
    robot = ',robot="ant"' if kind == "python_body" else ""
    ran = discover(TARGET, "--set", f"{table}{robot}}}")
    assert ran.returncode == 2 and "`simulator.files.gear`: there is no file" in ran.stderr, ran.stderr


TARGET = 'target = "toys:Mass"'

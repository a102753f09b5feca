"""Option sets."""

from __future__ import annotations

import json
import operator
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from elo import _elo

Observation = npt.ArrayLike
Action = npt.NDArray[np.float32]

FILES = ("manifest.json", "options.safetensors")
"""What a set's folder holds."""


@dataclass(frozen=True, repr=False)
class OptionSet:
    """K options of one robot, best first.

    An option is its interest (how much it wants to begin), its policy and its termination. All are functions of the
    observation and of how many steps the option has been running; options hold no state of an episode. A pickled set needs no
    folder: it brings its files.

    Methods raise IndexError for the number of no option, TypeError for a number that is no whole one, and ValueError for one below
    0 and for an observation of another size or with numbers that are not finite.
    """

    manifest: dict[str, Any]
    """What `manifest.json` says: robot, sizes, horizon, how the set was selected, and the whole config of its run."""
    _options: _elo.Options
    _files: tuple[bytes, ...]

    def __repr__(self) -> str:
        robot, metric = self.manifest["spec"]["robot"], self.manifest["metric"]
        return f"<OptionSet: {len(self)} options of {robot} by {metric}, T = {self.steps}>"

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpacked, self._files

    def __len__(self) -> int:
        return len(self._options)

    @property
    def steps(self) -> int:
        """T: control steps for which an option was made."""
        return int(self.manifest["horizon"]["steps"])

    @property
    def observation_size(self) -> int:
        """Numbers in an observation."""
        return int(self.manifest["spec"]["observation_size"])

    @property
    def control_step(self) -> float:
        """Simulated seconds between two actions."""
        return float(self.manifest["spec"]["control_step"])

    @property
    def action_low(self) -> Action:
        """Least useful value of each action component."""
        return np.asarray(self.manifest["spec"]["action_low"], np.float32)

    @property
    def action_high(self) -> Action:
        """Greatest useful value of each action component."""
        return np.asarray(self.manifest["spec"]["action_high"], np.float32)

    def act(self, option: int, observation: Observation, elapsed: int, seed: int = 0) -> Action:
        """What option number `option` does at `observation` (observation_size numbers) after `elapsed` of its steps.

        `seed`, a number of up to 64 bits, feeds options that draw their actions, such as those of the learner `interest`: give
        each step another one. Gives an array of the action's size, clipped to `action_low` and `action_high`.
        """
        return self._options.act(self._when(option, elapsed), _array(observation), _natural(seed, "seed"))

    def termination(self, option: int, observation: Observation, elapsed: int) -> float:
        """The probability that the option ends before its next action; 1 after `steps` for options of fixed length."""
        return self._options.termination(self._when(option, elapsed), _array(observation))

    def interests(self, observation: Observation) -> npt.NDArray[np.float32]:
        """How much each option wants to begin at `observation`: positive numbers, all equal for options without interest.

        See `draw`. Interests mean something only beside those of the same set.
        """
        return np.asarray(self._options.interests(_array(observation)), np.float32)

    def draw(self, observation: Observation, generator: np.random.Generator) -> int:
        """The number of the option that an infant agent begins at `observation`: by interest, π_I of Eq. 6.3.

        `generator` is NumPy's, e.g. `numpy.random.default_rng(1)`.
        """
        interests = self.interests(observation).astype(np.float64)
        return int(generator.choice(len(self), p=interests / interests.sum()))

    def _when(self, option: int, elapsed: int) -> tuple[int, int]:
        number = operator.index(option)
        if not 0 <= number < len(self):
            raise IndexError(f"option {number} of a set of {len(self)}")
        return number, _natural(elapsed, "elapsed")


def load(path: str | os.PathLike[str]) -> OptionSet:
    """Reads the option set in a folder, e.g. `runs/NAME/results/option_sets/maximum_mean`.

    Raises FileNotFoundError when there is no such folder, ValueError when a file is missing, damaged, or of a format that this version
    does not read. A changed number in the tensors is found by their hash in the manifest; sets of format 1 have none.
    """
    if not Path(path).is_dir():
        raise FileNotFoundError(f"there is no folder {os.fspath(path)}; `elo discover` writes option sets to results/option_sets/METRIC")
    options = _elo.Options(os.fspath(path))
    return OptionSet(json.loads(options.manifest()), options, tuple((Path(path) / name).read_bytes() for name in FILES))


def _unpacked(*files: bytes) -> OptionSet:
    """The set with these `FILES`."""
    with tempfile.TemporaryDirectory() as folder:
        for name, data in zip(FILES, files, strict=True):
            (Path(folder) / name).write_bytes(data)
        return load(folder)


def _array(observation: Observation) -> npt.NDArray[np.float32]:
    array = np.ascontiguousarray(observation, dtype=np.float32).reshape(-1)
    finite = np.isfinite(array)
    if not finite.all():
        place = int(np.argmin(finite))
        raise ValueError(f"observation[{place}] is {array[place]}, expected finite numbers")
    return array


def _natural(value: int, name: str) -> int:
    number = operator.index(value)
    if not 0 <= number < 2**64:
        raise ValueError(f"`{name}` is {number}, expected a whole number from 0 to 2^64 - 1")
    return number

"""Early-life options in Python: load option sets that the program `elo` selected, and act by them.

>>> import elo
>>> options = elo.load("runs/half-cheetah-quick/results/option_sets/maximum_mean")
>>> action = options.act(0, observation, elapsed=0)

`elo.gym` has the environments of this project and a wrapper whose actions are options; it needs Gymnasium.
"""

from elo._options import OptionSet, load

__all__ = ["OptionSet", "load"]

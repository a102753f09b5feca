"""`python -m elo.worker`: does units of the program `elo` that need Python. `elo` starts it; nobody else needs to."""

from __future__ import annotations

import platform


def main() -> None:
    """Serves units on standard input and output until the other side closes them."""
    from elo import _elo

    _elo.serve(f"python {platform.python_version()}")


if __name__ == "__main__":
    main()

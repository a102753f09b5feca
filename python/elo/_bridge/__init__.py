"""Between code of users in Python and the plugins in `backends/src/python`: a module each for environments, bodies, teachers
and metrics. The Rust side makes a `Bridge` of one of them from the plugin's config. Here is what they share.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.metadata
import inspect
import platform
import sys
import traceback
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any

import numpy as np

VERSIONED = {"elo", "gymnasium", "numpy", *sys.stdlib_module_names}
"""Top modules of which a version says enough."""


class BadTarget(Exception):
    """A user's code is not what the config needs. The message is for its author; it comes without a traceback."""


def tell(error: BaseException, trace: TracebackType | None) -> str:
    """An exception in words for a report, with its way through the user's code."""
    if isinstance(error, BadTarget):
        return str(error)
    told = traceback.TracebackException(type(error), error, trace)
    told.stack = traceback.StackSummary.from_list([frame for frame in told.stack if not _is_own(frame.filename)])
    lines = told.format() if told.stack else told.format_exception_only()
    return "".join(lines).strip()


def _is_own(file: str) -> bool:
    """Whether it is code that is between elo and the user's."""
    return file.startswith("<frozen importlib") or Path(file).parent == Path(__file__).parent


def find(target: str, otherwise: str = "") -> Any:
    """What `module:name` means. `otherwise` is what else a target may be, for messages."""
    module_name, colon, name = target.partition(":")
    if not colon:
        forms = f"neither {otherwise} nor" if otherwise else "not"
        raise BadTarget(f"`{target}` is {forms} `module:callable`")
    made: Any = imported(module_name, target)
    for part in name.split("."):
        if not hasattr(made, part):
            raise BadTarget(f"`{target}`: module `{module_name}` has no `{name}`")
        made = getattr(made, part)
    if not callable(made):
        raise BadTarget(f"`{target}` is {type(made).__name__}, expected something that can be called")
    return made


def imported(module: str, target: str) -> ModuleType:
    """A module that `target` names."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise BadTarget(
            f"`{target}`: {sys.executable} finds no module `{error.name}`; install it there, or name its folder in "
            "`workers.python_path`"
        ) from error


def origins(target: str, *things: Any) -> list[str]:
    """The modules that what `target` gives was written in: the one that it names, and those of `things` (functions, classes and
    objects) and of the classes that they derive from, but for libraries whose versions are noted anyhow."""
    named = [target.partition(":")[0]] if ":" in target else []
    found: list[str] = []
    for thing in things:
        kind = thing if isinstance(thing, type) else type(thing)
        found += [getattr(thing, "__module__", None) or "", *(base.__module__ for base in kind.__mro__)]
    return list(dict.fromkeys(named + [module for module in found if module and module.partition(".")[0] not in VERSIONED]))


def versions(modules: Iterable[str], *packages: str) -> str:
    """What results of code in `modules` depend on: versions of Python, NumPy, these packages and the modules' own, and a hash of
    each module's source."""
    modules = list(modules)
    parts = [f"python {platform.python_version()}", f"numpy {np.__version__}"]
    for name in [*packages, *(name for module in modules for name in _distributions(module))]:
        try:
            parts.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            continue
    return ", ".join(dict.fromkeys([*parts, *map(_hash, modules)]))


def hashes(files: Mapping[str, str]) -> list[str]:
    """What is in the files that code is given, by the names of their arguments."""
    return [f"{name} {hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]}" for name, path in sorted(files.items())]


def _hash(module: str) -> str:
    try:
        source = inspect.getsource(sys.modules[module])
    except (OSError, TypeError, KeyError):
        source = ""
    return f"{module} {hashlib.sha256(source.encode()).hexdigest()[:16]}"


def _distributions(module: str) -> list[str]:
    """What must be installed for there to be the module: mostly a distribution of the same name."""
    top = module.partition(".")[0]
    file = getattr(sys.modules.get(top), "__file__", None) or ""
    installed = "site-packages" in file or "dist-packages" in file
    return sorted(_all_distributions().get(top, [top])) if installed else [top]


@functools.cache
def _all_distributions() -> Mapping[str, list[str]]:
    return importlib.metadata.packages_distributions()

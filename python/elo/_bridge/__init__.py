"""Between code of users in Python and the plugins in `backends/src/python`: a module each for environments, bodies, teachers
and metrics. The Rust side makes a `Bridge` of one of them from the plugin's config. Here is what they share.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.metadata
import inspect
import platform
import sys
import traceback
from typing import Any

import numpy as np


class BadTarget(Exception):
    """A user's code is not what the config needs. The message is for its author; it comes without a traceback."""


def tell(error: BaseException) -> str:
    """An exception in words for a report."""
    if isinstance(error, BadTarget):
        return str(error)
    return "".join(traceback.format_exception(error)).strip()


def find(target: str, otherwise: str = "") -> Any:
    """What `module:name` means. `otherwise` is what else a target may be, for messages."""
    module_name, colon, name = target.partition(":")
    if not colon:
        forms = f"neither {otherwise} nor" if otherwise else "not"
        raise BadTarget(f"`{target}` is {forms} `module:callable`")
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        raise BadTarget(
            f"`{target}`: {sys.executable} finds no module `{error.name}`; install it there, or name its folder in "
            "`workers.python_path`"
        ) from error
    made = module
    for part in name.split("."):
        if not hasattr(made, part):
            raise BadTarget(f"`{target}`: module `{module_name}` has no `{name}`")
        made = getattr(made, part)
    if not callable(made):
        raise BadTarget(f"`{target}` is {type(made).__name__}, expected something that can be called")
    return made


def versions(module: str, *packages: str) -> str:
    """What results of code in `module` depend on: versions of Python, NumPy, these packages and the module's own, and a hash of
    the module's source."""
    parts = [f"python {platform.python_version()}", f"numpy {np.__version__}"]
    for package in (*packages, module.partition(".")[0]):
        try:
            version = f"{package} {importlib.metadata.version(package)}"
        except importlib.metadata.PackageNotFoundError:
            continue
        if version not in parts:
            parts.append(version)
    try:
        source = inspect.getsource(sys.modules[module])
    except (OSError, TypeError, KeyError):
        source = ""
    parts.append(f"{module} {hashlib.sha256(source.encode()).hexdigest()[:16]}")
    return ", ".join(parts)

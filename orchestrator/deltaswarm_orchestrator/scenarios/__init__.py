"""Read scenarios; those that are built in are here."""

from importlib import resources
from importlib.resources.abc import Traversable


def files_in(*folders: str, package: str = "deltaswarm_orchestrator") -> dict[str, Traversable]:
    """Return the TOML files in folders of a package, by name without suffix."""
    files = [file for folder in folders for file in resources.files(package).joinpath(folder).iterdir()]
    named = {file.name.removesuffix(".toml"): file for file in files if file.name.endswith(".toml")}
    return dict(sorted(named.items()))


BUILT_IN = files_in("scenarios")
LANGUAGES = files_in("languages")
DEFAULT_SCENARIO = "paper-25"

"""The passwords of one run, which the world makes for its router and all parts need."""

import shutil
from pathlib import Path

SECRETS = "secrets"


class Passwords:
    """They lie in a folder of the run folder until the router has read them, so that a kill leaves none elsewhere."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / SECRETS
        self.file = self._folder / "credentials"
        """Where the world writes them, a line per user."""
        self._by_user: dict[str, str] = {}
        self.remove_file()
        self._folder.mkdir(mode=0o700)

    def take(self) -> None:
        """Read the file, and remove it at once: an orchestrator that is killed could not do so later."""
        pairs = (line.partition(":") for line in self.file.read_text().splitlines())
        self._by_user = {user: password for user, _, password in pairs}
        self.remove_file()

    def of(self, user: str) -> str:
        """Return a user's password.

        Raises:
            KeyError: there is no such user, or they are not taken yet.
        """
        return self._by_user[user]

    def remove_file(self) -> None:
        """Remove the file, if there is one, and its folder."""
        shutil.rmtree(self._folder, ignore_errors=True)

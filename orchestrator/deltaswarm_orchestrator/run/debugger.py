"""Stop in Python's debugger where a plug-in raised (`--debug`)."""

import pdb
import sys

from deltaswarm_wire.plugin_errors import PluginError, own_traceback


class Debugger:
    """Debugs the first failure of a plug-in; the run ends when the user leaves the debugger."""

    def __init__(self) -> None:
        self.was_left = False

    def __call__(self, error: PluginError) -> None:
        """Show an error, and stop at the line that raised it."""
        raised = error.__cause__
        if self.was_left or raised is None:
            return
        print(f"{error.report}\nThe run ends when you leave the debugger (q).", file=sys.stderr)
        try:
            pdb.post_mortem(own_traceback(raised))
        finally:
            self.was_left = True

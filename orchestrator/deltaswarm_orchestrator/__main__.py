"""The command `deltaswarm`, also as `python -m deltaswarm_orchestrator`."""

import sys

from deltaswarm_orchestrator.stopping import end_at_once_on_signals


def main() -> int:
    """Run one command; its exit code. What takes long to import comes after the signals."""
    end_at_once_on_signals()
    from deltaswarm_orchestrator import cli

    return cli.main()


if __name__ == "__main__":
    sys.exit(main())

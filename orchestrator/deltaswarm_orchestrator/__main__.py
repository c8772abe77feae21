"""`python -m deltaswarm_orchestrator`: the same as the command `deltaswarm`."""

import sys

from deltaswarm_orchestrator.cli import main

if __name__ == "__main__":
    sys.exit(main())

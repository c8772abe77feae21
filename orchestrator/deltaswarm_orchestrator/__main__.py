"""`python -m deltaswarm_orchestrator` is the command `deltaswarm`."""

import sys

from deltaswarm_cli.__main__ import main

if __name__ == "__main__":
    sys.exit(main())

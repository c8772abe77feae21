"""A client of a Dask scheduler. Only what needs Dask imports this module."""

import gc
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from distributed import Client
from distributed.versions import VersionMismatchWarning

CONNECT_WITHIN_S = 10.0


def silence_dask() -> None:
    """Let our one-line errors replace the tracebacks that Dask logs, and its table of other packages' versions."""
    warnings.simplefilter("ignore", VersionMismatchWarning)
    for name in ("distributed", "distributed.client", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)


@contextmanager
def client_of(address: object, within_s: float = CONNECT_WITHIN_S) -> Iterator[Client]:
    """Connect a client to the scheduler at an address, or to that of a cluster of this process.

    Raises:
        ConnectionError: there is none that can be reached; the text says why.
    """
    problem = ""
    try:
        client = Client(address, timeout=within_s)
    except Exception as error:  # whatever Dask's own code raises, such as TypeError without its settings for TLS
        problem = str(error) or type(error).__name__
    if problem:
        gc.collect()  # closes the unconnected client here: if one of Dask's threads collected it, that might deadlock
        raise ConnectionError(problem)
    with client:
        yield client

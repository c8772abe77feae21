"""One run over many machines: agents' processes on the workers of a cluster, everything else here."""

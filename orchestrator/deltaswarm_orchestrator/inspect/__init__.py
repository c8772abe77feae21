"""Questions about a run that is over or was interrupted."""

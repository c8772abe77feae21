"""The operator's station: a page in a browser, served by a process that knows only what its feed sends it."""

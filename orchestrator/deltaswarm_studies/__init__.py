"""Studies: from a question in a TOML file to runs and a page with figures and verdicts."""

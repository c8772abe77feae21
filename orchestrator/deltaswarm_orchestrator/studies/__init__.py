"""Studies: a question as a TOML file, from its runs to a page with figures and verdicts."""

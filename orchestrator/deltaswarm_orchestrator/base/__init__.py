"""What every part of the orchestrator uses: exit codes, texts, provenance, and what the system offers."""

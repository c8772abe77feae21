"""The operator: receives what the swarm reports and measures how much that is."""

ANY_PORT = "127.0.0.1:0"
"""Where a page is served by default: on this machine alone, at any free port."""

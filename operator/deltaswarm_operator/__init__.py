"""The operator: receives what the swarm reports and measures how much that is."""

"""What this machine allows, and what a swarm costs on it."""

"""Measure what this machine allows, and what a swarm costs on it."""

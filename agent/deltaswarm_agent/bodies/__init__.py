"""The bodies that come with the agent."""

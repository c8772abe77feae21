"""How the coordination modes fare when communication is limited: the question that the paper leaves open."""

"""Sessions with participants."""

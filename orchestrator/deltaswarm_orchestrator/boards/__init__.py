"""Boards: what each is given, and the certificates of those that take part."""

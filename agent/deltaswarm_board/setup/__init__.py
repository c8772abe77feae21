"""Boards: the files that each is given, and the certificates of all participants."""

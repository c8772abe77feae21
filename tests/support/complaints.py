"""Recognizes error messages by key and value, whatever their wording."""

import re


def names(line: str, said: str) -> bool:
    """Whether an error names a key and, where `said` is `key: value`, the value that was found."""
    path, _, found = said.partition(": ")
    return re.match(rf"(deltaswarm: )?{re.escape(path)}(:? |$)", line) is not None and found in line

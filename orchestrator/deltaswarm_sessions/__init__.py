"""Studies with participants: the design, one participant's session, and the tables of all."""

MAX_PARTICIPANT = 9999

BIDS, PSYCH_DS = "bids", "psych-ds"
DATASETS = (BIDS, PSYCH_DS)
"""The kinds of datasets in which tables are exported."""

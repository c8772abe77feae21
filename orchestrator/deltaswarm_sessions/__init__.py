"""Studies with participants: the design, one participant's session, and the tables of all."""

MAX_PARTICIPANT = 9999

AGENTS = IN_PROCESS, PROCESSES = "in-process", "processes"
"""Where the agents of a session's runs are: in one process with all else, or in one each."""

BIDS, PSYCH_DS = "bids", "psych-ds"
DATASETS = (BIDS, PSYCH_DS)
"""The kinds of datasets in which tables are exported."""

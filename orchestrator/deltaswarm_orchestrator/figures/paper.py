"""What the paper's text gives of its figures (Results); medians with interquartile ranges of 20 replicates."""

WAITING_TIME_S = {
    "decentralised": (42.1, 4.7),
    "hierarchical": (34.0, 12.0),
    "hybrid 3": (26.4, 8.8),
}
"""Mean waiting time per replicate, median and interquartile range [s]; the paper's box plot for 25 agents."""

ABLATION_WAITING_TIME_S = {
    "hybrid 3": (26.4, 8.8),
    "no recruitment": (45.9, 8.8),
    "no dissolution": (27.6, 10.8),
    "decentralised": (42.7, 5.2),
}
"""The same in the ablation study, which gives the decentralised swarm anew."""

OPERATOR_MESSAGES_PER_S = {
    "decentralised": (9.9, 0.38),
    "hierarchical": (4.5, 0.42),
    "hybrid 3": (3.9, 0.50),
}
"""Messages to the operator, median and interquartile range [1/s]."""

AGENTS_IN_TREES = {"25 agents": 12.0, "100 agents": 33.0}
"""Agents in trees to which a swarm with hybrid control, delta 3, converges."""

COVERED_AREA_M2 = {"25 agents": 672.0, "100 agents": 1521.0}
"""Mean area that these trees cover [m2]."""

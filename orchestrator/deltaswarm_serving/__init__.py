"""Studies by link: one service with one address for all participants, who take part at the same time from anywhere."""

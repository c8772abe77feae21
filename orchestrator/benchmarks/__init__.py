"""The developers' instruments: what a swarm costs on a machine, in more ways than `deltaswarm bench run` measures."""

"""The control structures of Kelly et al., decentralised, hierarchical and hybrid: each of the paper's rules in a file.

`baseline` is the paper's Baseline coordination algorithm, `root_formation` Root Formation, `growth` Tree Growth,
`recruitment` Active Recruitment, `dissolution` Dissolution, `hybrid` Hybrid coordination. The others are what real messages
require: `membership` and `orphans` (a place in a tree, kept and regained), `root_contest` (two roots that
meet), `beliefs` (what a member knows of events), `frames` (the bytes on the air), `states` (the states and every
transition).
"""

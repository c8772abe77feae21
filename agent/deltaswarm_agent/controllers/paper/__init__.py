"""The control structures of Kelly et al., decentralised, hierarchical and hybrid: each of the paper's rules in a file.

`baseline` is the paper's Baseline coordination algorithm, `root_formation` Root Formation, `growth` Tree Growth,
`recruitment` Active Recruitment, `dissolution` Dissolution, `hybrid` Hybrid coordination. The others are what real
messages require: `membership` and `orphans` (keeping and regaining a place in a tree), `root_contest` (two roots that
meet), `beliefs` (a member's knowledge of events), `frames` (payloads of radio frames), `states` (states and
transitions).
"""

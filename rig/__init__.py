"""The test rig of `tests` and `benchmarks`, beside what is shipped in `testing`.

- `hosts.Network`: hosts on a network that can be cut and made to lose packets (Linux, root).
- `local_cluster.LocalCluster`: a real cluster of three, to lose one of them.
- `peers`: the other ends of a bridge, each a program.
- `processes.Process`: a process that is listened to, killed and started again.
- `topics.records`: what a topic holds, up to its end.
"""

"""What tests share, by rooms.

- `gate`: the rules that hold for all tests, as plugins of pytest.
- `processes`: how processes are started, held and ended; `patience` says how long for.
- `kafka`, `ros`, `registry`, `formats`, `spools`: real ends, and what is written and read there.
- `bridges`: what tests of a whole bridge begin with and look at.
- `worlds`: pipelines and their ends in memory, and what can happen to them at random.
- `monitoring`: pages, metrics and traces, and who looks at them.
- `install`: the project as users get it.
- `warehouse`: floors, fleets and robots.
"""
